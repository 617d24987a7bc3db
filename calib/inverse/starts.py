"""Starts: joints from which every branch of a position is reached, as the links propose them."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..common.scale import Scale
from ..maps.association import Association
from .newton import CLOSE, Newton, shortened

_SENSORY = 3  # sensory nodes whose partners are looked at
_REACH = 2.0  # a node's first step is at most so many node spacings long
_MOST = 60  # proposals of a target
_CELL = 1.5  # proposals closer than so many node spacings count as one
_APART = 0.3  # solutions of two joints closer than so many spacings are one
_MISSED = 2.0  # a start may miss its sensory node by so many of its spacings
_WIDTH, _WIDEST = 8, 32  # most starts of a sensory node, and of redundant arms
_AHEAD = 48  # sensory nodes that a single query makes known
FOLDED = 0.05  # share of the Jacobian's sum of squares of the least direction beside a fold
_FLAT = 1e-2  # of the largest singular value: directions below are left out of a first step

_PROBE = 1e-4  # of the joints' range: step of the derivative of the least singular value


class Starts:
    """For each sensory node the joints that lead there: one start per branch.

    Every motor node that was ever active with it is linked to it.  Starts are refined and merged
    when a sensory node is first asked for, and kept: many targets share them.
    """

    def __init__(self, association: Association, newton: Newton) -> None:
        self.association, self.newton = association, newton
        nodes, dof = association.sensory.size, association.motor.units.shape[1]
        self._redundant = dof > association.sensory.units.shape[1]
        self._known = np.zeros(nodes, dtype=bool)
        self._u = np.full((nodes, _WIDEST if self._redundant else _WIDTH, dof), np.nan)
        self._value = np.zeros((*self._u.shape[:2], association.sensory.units.shape[1]))
        self._inverse = np.zeros((*self._u.shape, self._value.shape[2]))
        self._folded = np.zeros(nodes, dtype=bool)

    def of(self, x: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Starts (n, k, dof) for targets `x` (n, m), and whether a fold may be near (n,).

        They are those of the nearest node, a linear step towards the target on; NaN fills rows.
        """
        sensory = self.association.sensory
        node = sensory.nearest(sensory.scale.to_unit(x))[1][:, 0]
        missing = node[~self._known[node]]
        if 0 < len(missing) < _AHEAD:  # single queries follow each other: their neighbours, too
            around = sensory.nearest(sensory.units[missing], min(_AHEAD, sensory.size))[1]
            missing = around[~self._known[around]]
        if len(missing):
            self._learn(np.unique(missing))
        step = _linear(self._inverse[node], x[:, None] - self._value[node])
        u = self._u[node].reshape(-1, self._u.shape[2])
        u = u + shortened(step.reshape(u.shape), _REACH * self.association.motor.spacing)
        return self.newton.clip(u).reshape(step.shape), self._folded[node]

    def _learn(self, nodes: Index) -> None:
        """Refine what the links propose for sensory nodes, the best of each branch."""
        motor, sensory = self.association.motor, self.association.sensory
        x = sensory.scale.from_unit(sensory.units[nodes])
        target, u = self.propose(x)
        u, missed = self.newton.refine(u, x[target], CLOSE)
        order = np.lexsort((missed, target))
        target, u, missed = target[order], u[order], missed[order]
        near = missed <= _MISSED * sensory.spacing * float(sensory.scale.span.mean())
        near |= place_of(target) == 0
        target, u, hit = target[near], u[near], missed[near] <= CLOSE * self.newton.extent
        apart = np.where(hit, _CELL if self._redundant else _APART, 1.0) * motor.spacing
        keep = distinct(motor.scale, target, u, apart)
        target, u = target[keep], u[keep]
        place = place_of(target)
        fits = place < self._u.shape[1]
        at, u = (nodes[target[fits]], place[fits]), u[fits]
        self._u[at] = u
        self._value[at], slope = self.newton.task.value_and_slope(u)
        self._inverse[at] = np.linalg.pinv(slope, rcond=_FLAT)
        if not self._redundant:
            size = np.asarray(np.linalg.svd(slope, compute_uv=False), dtype=float)
            self._folded[at[0][folded(size, FOLDED)]] = True
        self._known[nodes] = True

    def propose(self, x: Array, sensory_nodes: int = _SENSORY) -> tuple[Index, Array]:
        """What the links say of targets `x` (n, m): joints (k, dof), and of which target (k,).

        Joints are in the unit box, one node's linear step towards the target, unrefined; targets
        ascend.
        """
        motor, sensory = self.association.motor, self.association.sensory
        seen = sensory.nearest(sensory.scale.to_unit(x), min(sensory_nodes, sensory.size))[1]
        found = self.association.partners.take(seen.ravel())
        pair = np.unique(found.rows // seen.shape[1] * motor.size + found.indices)
        target, node = np.divmod(pair, motor.size)
        value, inverse = self._nodes
        step = _linear(inverse[node], x[target] - value[node])
        length = np.linalg.norm(step, axis=1) / motor.spacing
        u = self.newton.clip(motor.units[node] + shortened(step, _REACH * motor.spacing))
        # one proposal per cell: the one with the shortest step
        cell = np.floor(u / (_CELL * motor.spacing)).astype(np.int64)
        order = np.lexsort((length, *cell.T, target))
        key = np.column_stack([target, cell])[order]
        keep = order[np.append(True, np.any(key[1:] != key[:-1], axis=1))[: len(order)]]
        # where none is likely (a target out of reach, a singular pose) the best three
        keep = keep[np.lexsort((length[keep], target[keep]))]
        close, owner = length[keep] <= _REACH, target[keep]
        likely = np.bincount(owner, close, minlength=len(x))[owner] > 0
        most = np.where(likely, _MOST, 3)
        keep = keep[(close | ~likely) & (place_of(owner) < most)]
        return target[keep], u[keep]

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Position (nodes, m) and inverse Jacobian (nodes, dof, m) of each node."""
        units = np.clip(self.association.motor.units, 0.0, 1.0)
        value, slope = self.newton.task.value_and_slope(units)
        return value, np.asarray(np.linalg.pinv(slope, rcond=_FLAT), dtype=float)


def _linear(inverse: Array, gap: Array) -> Array:
    """Steps (..., dof) that inverse Jacobians (..., dof, m) take along gaps (..., m)."""
    return np.asarray((inverse * gap[..., None, :]).sum(axis=-1))


def folded(size: Array, share: float) -> NDArray[np.bool_]:
    """Whether the least of singular values (n, m) tells a fold (n,): its share of their squares."""
    return np.asarray(size[:, -1] ** 2 <= share * (size * size).sum(axis=1))


def drawn(n: int, dof: int, beyond: float = 0.0) -> Array:
    """Joints (n, dof) at random all over their ranges; those `beyond` a limit stand at it."""
    u = np.random.default_rng(0).random((n, dof))
    return np.clip(u * (1.0 + 2.0 * beyond) - beyond, 0.0, 1.0)


def place_of(owner: Index) -> Index:
    """The how many-eth of its owner each row is, of owners (n,) that ascend."""
    return np.arange(len(owner)) - np.searchsorted(owner, owner)


def distinct(scale: Scale, target: Index, u: Array, apart: Any) -> NDArray[np.bool_]:
    """Which joints (n, dof), sorted by target, are `apart` from all earlier ones that stay."""
    keep, apart = np.ones(len(u), dtype=bool), np.broadcast_to(apart, len(u))
    for lag in range(1, int(np.bincount(target).max(initial=0))):
        later = np.flatnonzero(target[lag:] == target[:-lag]) + lag
        gap = np.abs(scale.difference(u[later], u[later - lag])).max(axis=1)
        same = gap < np.minimum(apart[later], apart[later - lag])
        keep[later[same & keep[later - lag]]] = False
    return keep


def twins(newton: Newton, u: Array, share: float, far: Any) -> tuple[Index, Array]:
    """Starts (m, dof) for the solutions across a nearby fold of `u` (n, dof), and of which rows.

    At a fold, where the Jacobian loses a direction, two solutions meet. Along the direction that
    hardly moves the tip its least singular value falls linearly to zero, and the other solution
    lies about as far beyond as this one lies before: no more than `far` (n,). Folds are looked for
    where that direction has no more than a `share` of the Jacobian's sum of squares.
    """
    slope = newton.task.value_and_slope(u)[1]
    sides, size, ways = np.linalg.svd(slope, full_matrices=False)
    rows = np.flatnonzero(folded(size, share))
    if not len(rows):
        return rows, u[:0]
    side, flat = sides[rows, :, -1], ways[rows, -1]
    ahead, behind = (
        np.einsum(
            "nm,nmd,nd->n", side, newton.task.value_and_slope(u[rows] + probe * flat)[1], flat
        )
        for probe in (_PROBE, -_PROBE)
    )
    rate = (ahead - behind) / (2 * _PROBE)
    reach = -2.0 * size[rows, -1] / np.where(rate == 0.0, np.inf, rate)
    near = (np.abs(reach) < np.broadcast_to(far, len(u))[rows]) & (reach != 0.0)
    return rows[near], newton.clip(u[rows[near]] + reach[near, None] * flat[near])
