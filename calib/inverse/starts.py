"""Starts: joints from which every branch of a position is reached, as the links propose them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..common.scale import Scale
from ..maps.association import Association
from .newton import Newton, shortened
from .settings import SEARCH


@dataclass(frozen=True)
class StartSettings:
    """How links are followed: lengths are node spacings of the motor map unless said."""

    sensory: int = 3  # sensory nodes whose partners are looked at
    step: float = 2.0  # longest first step of a node
    most: int = 60  # proposals of a target
    unlikely: int = (
        3  # proposals where none is likely: out of reach, or in a singular pose
    )
    cell: float = 1.5  # proposals that are closer count as one
    apart: float = 0.3  # solutions of two joints that are closer are one
    missed: float = (
        2.0  # spacings of the sensory map by which a start may miss its node
    )
    width: int = 8  # most starts of a sensory node
    spare_width: int = 32  # the same, of redundant arms
    ahead: int = 48  # sensory nodes that a single query makes known
    flat: float = (
        1e-2  # of the largest singular value: less is left out of a first step
    )
    probe: float = (
        1e-4  # of the joints' range: step of the derivative of a singular value
    )


STARTS = StartSettings()


class Starts:
    """For each sensory node the joints that lead there: one start per branch.

    Every motor node that was ever active with it is linked to it.  Starts are refined and merged
    when a sensory node is first asked for, and kept: many targets share them.
    """

    def __init__(self, association: Association, newton: Newton) -> None:
        self.association = association
        self.newton = newton
        nodes = association.sensory.size
        dof = association.motor.units.shape[1]
        outputs = association.sensory.units.shape[1]
        self._redundant = dof > outputs
        self._width = STARTS.spare_width if self._redundant else STARTS.width
        self._known = np.zeros(nodes, dtype=bool)
        self._u = np.full((nodes, self._width, dof), np.nan)
        self._value = np.zeros((nodes, self._width, outputs))
        self._inverse = np.zeros((nodes, self._width, dof, outputs))
        self._folded = np.zeros(nodes, dtype=bool)

    def of(self, x: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Starts (n, k, dof) for targets `x` (n, m), and whether a fold may be near (n,).

        They are those of the nearest node, a linear step towards the target on; NaN fills rows.
        """
        sensory = self.association.sensory
        node = sensory.nearest(sensory.scale.to_unit(x))[1][:, 0]
        missing = node[~self._known[node]]
        if (
            0 < len(missing) < STARTS.ahead
        ):  # single queries follow each other: neighbours, too
            around = sensory.nearest(
                sensory.units[missing], min(STARTS.ahead, sensory.size)
            )[1]
            missing = around[~self._known[around]]
        if len(missing):
            self._learn(np.unique(missing))
        step = _linear(self._inverse[node], x[:, None] - self._value[node])
        longest = STARTS.step * self.association.motor.spacing
        dof = step.shape[2]
        u = self._u[node].reshape(-1, dof) + shortened(step.reshape(-1, dof), longest)
        return self.newton.clip(u).reshape(step.shape), self._folded[node]

    def _learn(self, nodes: Index) -> None:
        """Refine what the links propose for sensory nodes, the best of each branch."""
        motor = self.association.motor
        sensory = self.association.sensory
        x = sensory.scale.from_unit(sensory.units[nodes])
        target, u = self.propose(x)
        u, distance = self.newton.refine(u, x[target], SEARCH.close)
        order = np.lexsort((distance, target))
        target = target[order]
        u = u[order]
        distance = distance[order]
        near = distance <= STARTS.missed * sensory.spacing * float(
            sensory.scale.span.mean()
        )
        near |= rank_within(target) == 0
        target = target[near]
        u = u[near]
        met = distance[near] <= SEARCH.close * self.newton.extent
        apart = STARTS.cell if self._redundant else STARTS.apart
        single = distinct(
            motor.scale, target, u, np.where(met, apart, 1.0) * motor.spacing
        )
        target = target[single]
        u = u[single]
        place = rank_within(target)
        fits = place < self._width
        place = place[fits]
        node = nodes[target[fits]]
        u = u[fits]
        value, slope = self.newton.task.value_and_slope(u)
        self._u[node, place] = u
        self._value[node, place] = value
        self._inverse[node, place] = np.linalg.pinv(slope, rcond=STARTS.flat)
        if not self._redundant:
            size = np.asarray(np.linalg.svd(slope, compute_uv=False), dtype=float)
            self._folded[node[folded(size)]] = True
        self._known[nodes] = True

    def propose(
        self, x: Array, sensory_nodes: int = STARTS.sensory
    ) -> tuple[Index, Array]:
        """What the links say of targets `x` (n, m): of which target (k,), and joints (k, dof).

        Joints are in the unit box, one node's linear step towards the target, unrefined; targets
        ascend.
        """
        motor = self.association.motor
        sensory = self.association.sensory
        nodes = min(sensory_nodes, sensory.size)
        nearest = sensory.nearest(sensory.scale.to_unit(x), nodes)[1]
        partners = self.association.partners.take(nearest.ravel())
        pairs = np.unique(partners.rows // nodes * motor.size + partners.indices)
        target, node = np.divmod(pairs, motor.size)
        value, inverse = self._nodes
        step = _linear(inverse[node], x[target] - value[node])
        length = np.linalg.norm(step, axis=1) / motor.spacing
        step = shortened(step, STARTS.step * motor.spacing)
        u = self.newton.clip(motor.units[node] + step)
        # one proposal per cell: the one with the shortest step
        cell = np.floor(u / (STARTS.cell * motor.spacing)).astype(np.int64)
        order = np.lexsort((length, *cell.T, target))
        key = np.column_stack([target, cell])[order]
        first_of_cell = np.append(True, np.any(key[1:] != key[:-1], axis=1))[
            : len(order)
        ]
        rows = order[first_of_cell]
        rows = rows[np.lexsort((length[rows], target[rows]))]
        owner = target[rows]
        close = length[rows] <= STARTS.step
        likely = np.bincount(owner, close, minlength=len(x))[owner] > 0
        most = np.where(likely, STARTS.most, STARTS.unlikely)
        rows = rows[(close | ~likely) & (rank_within(owner) < most)]
        return target[rows], u[rows]

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Position (nodes, m) and inverse Jacobian (nodes, dof, m) of each node."""
        units = np.clip(self.association.motor.units, 0.0, 1.0)
        value, slope = self.newton.task.value_and_slope(units)
        return value, np.asarray(np.linalg.pinv(slope, rcond=STARTS.flat), dtype=float)


def _linear(inverse: Array, gap: Array) -> Array:
    """Steps (..., dof) that inverse Jacobians (..., dof, m) take along gaps (..., m)."""
    return np.asarray((inverse * gap[..., None, :]).sum(axis=-1))


def folded(size: Array) -> NDArray[np.bool_]:
    """Whether the least of singular values (n, m) tells a fold nearby (n,)."""
    return np.asarray(size[:, -1] ** 2 <= SEARCH.folded * (size * size).sum(axis=1))


def drawn(n: int, dof: int, beyond: float = 0.0) -> Array:
    """Joints (n, dof) at random all over their ranges; those `beyond` a limit stand at it."""
    u = np.random.default_rng(0).random((n, dof))
    return np.clip(u * (1.0 + 2.0 * beyond) - beyond, 0.0, 1.0)


def rank_within(owner: Index) -> Index:
    """Index of each row within those of its owner, of owners (n,) that ascend."""
    return np.arange(len(owner)) - np.searchsorted(owner, owner)


def distinct(
    scale: Scale, target: Index, u: Array, apart: Array | float
) -> NDArray[np.bool_]:
    """Which joints (n, dof), sorted by target, are `apart` from all earlier ones that stay."""
    stays = np.ones(len(u), dtype=bool)
    apart = np.broadcast_to(apart, len(u))
    for lag in range(1, int(np.bincount(target).max(initial=0))):
        later = np.flatnonzero(target[lag:] == target[:-lag]) + lag
        gap = np.abs(scale.difference(u[later], u[later - lag])).max(axis=1)
        same = gap < np.minimum(apart[later], apart[later - lag])
        stays[later[same & stays[later - lag]]] = False
    return stays


def twins(newton: Newton, u: Array) -> tuple[Index, Array]:
    """Rows (m,) of `u` (n, dof) near a fold, and starts (m, dof) for the solutions across it.

    At a fold, where the Jacobian loses a direction, two solutions meet.  Along the direction that
    hardly moves the tip its least singular value falls linearly to zero, and the other solution
    lies about as far beyond as this one lies before.
    """
    slope = newton.task.value_and_slope(u)[1]
    sides, size, directions = np.linalg.svd(slope, full_matrices=False)
    rows = np.flatnonzero(folded(size))
    if not len(rows):
        return rows, u[:0]
    side = sides[rows, :, -1]
    flat = directions[rows, -1]
    shift = STARTS.probe * flat
    ahead = newton.task.value_and_slope(u[rows] + shift)[1]
    behind = newton.task.value_and_slope(u[rows] - shift)[1]
    rate = np.einsum("nm,nmd,nd->n", side, ahead - behind, flat) / (2 * STARTS.probe)
    reach = -2.0 * size[rows, -1] / np.where(rate == 0.0, np.inf, rate)
    near = (np.abs(reach) < SEARCH.beyond) & (reach != 0.0)
    return rows[near], newton.clip(u[rows[near]] + reach[near, None] * flat[near])
