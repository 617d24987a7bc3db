"""Links: joints from which every branch of a position is reached, as Hebbian links propose them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common.arrays import Array, Index
from ..maps.association import Association
from .newton import Newton, shortened
from .search import Candidates, distinct, drawn, rank_within, with_others
from .settings import SEARCH


@dataclass(frozen=True)
class LinkSettings:
    """How links are followed: lengths are node spacings of the motor map unless said."""

    sensory: int = 3  # sensory nodes whose partners are looked at
    wide: int = 8  # the same, where others have failed
    step: float = 2.0  # longest first step of a node
    most: int = 60  # proposals of a target
    # proposals where none is likely: out of reach, or singular
    unlikely: int = 3
    cell: float = 1.5  # proposals that are closer count as one
    apart: float = 0.3  # solutions of two joints that are closer are one
    # spacings of the sensory map by which a start may miss its node
    missed: float = 2.0
    width: int = 8  # most starts of a sensory node
    spare_width: int = 32  # the same, of redundant arms
    ahead: int = 48  # sensory nodes that a single query makes ready
    # of the largest singular value: less is left out of a first step
    flat: float = 1e-2
    drawn: int = 32  # starts that are drawn besides, for each spare joint
    beyond: float = 0.2  # what is drawn so far beyond a limit is at it


LINKS = LinkSettings()


class LinkStarts:
    """For each sensory node the joints that lead there: one start per branch.

    Every motor node that was ever active with it is linked to it.  Starts are refined and merged
    when a sensory node is first asked for, and remembered: many targets share them.
    """

    def __init__(self, association: Association, newton: Newton) -> None:
        self.association = association
        self.newton = newton
        nodes = association.sensory.size
        dof = association.motor.units.shape[1]
        outputs = association.sensory.units.shape[1]
        self._drawn = LINKS.drawn * max(1, dof - outputs)
        self._width = LINKS.spare_width if newton.redundant else LINKS.width
        self._ready = np.zeros(nodes, dtype=bool)
        self._u = np.full((nodes, self._width, dof), np.nan)
        self._value = np.zeros((nodes, self._width, outputs))
        self._inverse = np.zeros((nodes, self._width, dof, outputs))

    def of(self, x: Array) -> Candidates:
        """Starts of the nearest node, a linear step towards each target `x` (n, m) on."""
        node = self._nearest_nodes(x)
        exists = np.isfinite(self._u[node, :, 0])
        target, column = np.nonzero(exists)
        node = node[target]
        gap = x[target] - self._value[node, column]
        step = _linear(self._inverse[node, column], gap)
        longest = LINKS.step * self.association.motor.spacing
        return target, self.newton.clip(
            self._u[node, column] + shortened(step, longest)
        )

    def more(self, x: Array) -> Candidates:
        """Starts of more nodes around, and some that are drawn."""
        target, u = self.propose(x, LINKS.wide)
        everywhere = drawn(self._drawn, u.shape[1], LINKS.beyond)
        return with_others(target, u, len(x), everywhere)

    def _nearest_nodes(self, x: Array) -> Index:
        """The sensory node nearest to each target (n,), made ready."""
        sensory = self.association.sensory
        node = sensory.nearest(sensory.scale.to_unit(x))[1][:, 0]
        missing = node[~self._ready[node]]
        if 0 < len(missing) < LINKS.ahead:  # single queries follow each other
            count = min(LINKS.ahead, sensory.size)
            around = sensory.nearest(sensory.units[missing], count)[1]
            missing = around[~self._ready[around]]
        if len(missing):
            self._prepare(np.unique(missing))
        return node

    def _prepare(self, nodes: Index) -> None:
        """Refine what the links propose for sensory nodes, the best of each branch."""
        motor = self.association.motor
        sensory = self.association.sensory
        x = sensory.scale.from_unit(sensory.units[nodes])
        target, u = self.propose(x)
        u, miss = self.newton.refine(u, x[target], SEARCH.close)
        order = np.lexsort((miss, target))
        target = target[order]
        u = u[order]
        miss = miss[order]
        spacing = sensory.spacing * float(sensory.scale.span.mean())
        near = (miss <= LINKS.missed * spacing) | (rank_within(target) == 0)
        target = target[near]
        u = u[near]
        solved = LINKS.cell if self.newton.redundant else LINKS.apart
        apart = np.where(self.newton.met(miss[near]), solved, 1.0)
        single = distinct(motor.scale, target, u, apart * motor.spacing)
        target = target[single]
        u = u[single]
        place = rank_within(target)
        fits = place < self._width
        place = place[fits]
        node = nodes[target[fits]]
        u = u[fits]
        value, inverse = self._linearised(u)
        self._u[node, place] = u
        self._value[node, place] = value
        self._inverse[node, place] = inverse
        self._ready[nodes] = True

    def propose(
        self, x: Array, sensory_nodes: int = LINKS.sensory
    ) -> Candidates:
        """Joints that the links propose for targets `x` (n, m), unrefined.

        They are a linear step of a motor node towards the target.
        """
        motor = self.association.motor
        sensory = self.association.sensory
        nodes = min(sensory_nodes, sensory.size)
        nearest = sensory.nearest(sensory.scale.to_unit(x), nodes)[1]
        partners = self.association.partners.take(nearest.ravel())
        pairs = np.unique(
            partners.rows // nodes * motor.size + partners.indices
        )
        target, node = np.divmod(pairs, motor.size)
        value, inverse = self._nodes
        step = _linear(inverse[node], x[target] - value[node])
        length = np.linalg.norm(step, axis=1) / motor.spacing
        step = shortened(step, LINKS.step * motor.spacing)
        u = self.newton.clip(motor.units[node] + step)
        # one proposal per cell: the one with the shortest step
        cell = np.floor(u / (LINKS.cell * motor.spacing)).astype(np.int64)
        order = np.lexsort((length, *cell.T, target))
        key = np.column_stack([target, cell])[order]
        first = np.ones(len(order), dtype=bool)
        first[1:] = (key[1:] != key[:-1]).any(axis=1)
        rows = order[first]
        rows = rows[np.lexsort((length[rows], target[rows]))]
        owner = target[rows]
        close = length[rows] <= LINKS.step
        likely = np.bincount(owner, close, minlength=len(x))[owner] > 0
        most = np.where(likely, LINKS.most, LINKS.unlikely)
        rows = rows[(close | ~likely) & (rank_within(owner) < most)]
        return target[rows], u[rows]

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Position (nodes, m) and inverse Jacobian (nodes, dof, m) of each motor node."""
        return self._linearised(np.clip(self.association.motor.units, 0.0, 1.0))

    def _linearised(self, u: Array) -> tuple[Array, Array]:
        """Position (n, m) and inverse Jacobian (n, dof, m) at joints (n, dof)."""
        origin = np.zeros((len(u), self.newton.task.count))
        back, slope = self.newton.task.residual(u, origin)
        inverse = np.asarray(
            np.linalg.pinv(slope, rcond=LINKS.flat), dtype=float
        )
        return -back, inverse


def _linear(inverse: Array, gap: Array) -> Array:
    """Steps (n, dof) that inverse Jacobians (n, dof, m) take along gaps (n, m)."""
    return np.asarray((inverse * gap[:, None]).sum(axis=2))
