"""Inverse: from a position to joints, through the links and the learned forward map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common.arrays import Array, Index
from ..common.scale import Scale
from ..maps.association import Association
from ..maps.predictor import Predictor
from .families import representatives
from .newton import CLOSE, Newton
from .starts import Starts, distinct, twins
from .tasks import Positions

_SAME = 1e-5  # of the joints' range: solutions that are closer are one
_SHORT = 0.03  # of the joints' range: after a first step so short the start is the joints given
_BESIDE = 0.005  # of the joints' range: an answer so near is on the same branch
_ALIKE = 4.0  # node spacings: solutions of redundant joints that are about as close
_FOLDED, _ACROSS = 0.05, 0.3  # as `twins` has them
_MANY, _DRAWN = 3, 128  # spare joints of which no lattice holds all families: starts are drawn
_WIDE = 8  # sensory nodes whose partners are tried where others have failed


@dataclass(frozen=True)
class Solver:
    """Solves forward(q) = x inside of the joints' range."""

    # its links propose where to start: every motor node that was ever active with the target, so
    # every branch is among them
    association: Association
    predictor: Predictor  # the learned forward map, whose own Jacobian is used

    @cached_property
    def extent(self) -> float:
        """Diagonal of the workspace [unit]."""
        return float(np.linalg.norm(self.association.sensory.scale.span))

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than coordinates of a position."""
        pair = self.association
        return bool(pair.motor.units.shape[1] > pair.sensory.units.shape[1])

    @cached_property
    def newton(self) -> Newton:
        """Damped steps towards a target."""
        return Newton(Positions(self.predictor.value_and_slope), self.scale, self.extent)

    @cached_property
    def starts(self) -> Starts:
        """Where the links say that a solution may be."""
        return Starts(self.association, self.newton)

    @property
    def scale(self) -> Scale:
        """Range of the joints."""
        return self.association.motor.scale

    def solve(self, x: Array, near: Array) -> tuple[Array, Array]:
        """The solution of each target that is nearest to given joints.

        x, near : (n, m), (n, dof), targets, and joints in the unit box
        Returns u : (n, dof), joints in the unit box; of a target out of reach those of the nearest
            attainable point
        Returns distance : (n,), what is left to the target
        """
        u, distance = self.clip(near), np.full(len(x), np.inf)
        beside = np.arange(len(x))
        if not self.redundant:
            step = self.newton.rate(u, x - self.predictor.value(u), 1e-12)
            beside = np.flatnonzero(np.abs(step).max(axis=1) < _SHORT)
        u[beside], distance[beside] = self.newton.settle(u[beside], x[beside], near[beside])
        away = np.linalg.norm(self.scale.difference(u, near), axis=1)
        alike = _ALIKE * self.association.motor.spacing if self.redundant else _BESIDE
        rows = np.flatnonzero((distance > CLOSE * self.extent) | (away > alike))
        if len(rows):  # where that misses or leads far away, from the links
            start = self.starts.of(x[rows])
            away = np.linalg.norm(self.scale.difference(start, near[rows, None]), axis=2)
            away = np.where(np.isnan(away), np.inf, away)
            first = away.min(axis=1, keepdims=True)
            close = away <= (first + alike if self.redundant else np.inf)
            owner, column = np.nonzero(close & np.isfinite(away))
            self._try(u, distance, x, near, rows[owner], start[owner, column])
            if not self.redundant:
                owner, across = twins(self.newton, u[rows], _FOLDED, _ACROSS)
                self._try(u, distance, x, near, rows[owner], across)
        missed = np.flatnonzero(distance > CLOSE * self.extent)
        if len(missed):  # and from more places
            for wider in (self.starts.propose(x[missed], _WIDE), self.starts.around(x[missed])):
                self._try(u, distance, x, near, missed[wider[0]], wider[1])
            missed = np.flatnonzero(distance > CLOSE * self.extent)
            u[missed], distance[missed] = self.newton.closest(u[missed], x[missed])
        return u, distance

    def _try(
        self, u: Array, left: Array, x: Array, near: Array, owner: Index, start: Array
    ) -> None:
        """Replace answers by better ones from starts (k, dof) for targets (k,), in place."""
        found = self.newton.settle(start, x[owner], near[owner])
        self.newton.take_better(u, left, near, owner, *found)

    def solve_all(self, x: Array) -> tuple[Index, Array, Array]:
        """Every distinct solution of each target.

        x : (n, m), targets
        Returns target : (m,), which target each solution belongs to, ascending; of a target out of
            reach there is one, the nearest attainable point.  Of redundant joints each connected
            family of solutions has one.
        Returns u : (m, dof), joints in the unit box; of a target the one nearest to the middle
            comes first
        Returns distance : (m,), what is left to the target
        """
        target, u, distance = self.solutions(x)
        if self.redundant and len(u):
            target, u = representatives(self.newton, target, u, x)
            distance = np.linalg.norm(self.predictor.value(u) - x[target], axis=1)
        lost = np.setdiff1d(np.arange(len(x)), target)
        if len(lost):
            found, found_distance = self.solve(x[lost], np.full((len(lost), u.shape[1]), 0.5))
            target = np.concatenate([target, lost])
            u, distance = np.concatenate([u, found]), np.concatenate([distance, found_distance])
        return self._by_middle(target, u, distance)

    def solutions(self, x: Array) -> tuple[Index, Array, Array]:
        """Solutions of each target as `solve_all` finds them, many of each family."""
        start = self.starts.of(x)
        target, column = np.nonzero(~np.isnan(start[..., 0]))
        u = start[target, column]
        if u.shape[1] >= x.shape[1] + _MANY:
            drawn = np.random.default_rng(0).random((_DRAWN, u.shape[1]))
            target = np.append(target, np.repeat(np.arange(len(x)), _DRAWN))
            u = np.concatenate([u, np.tile(drawn, (len(x), 1))])
        u, distance = self.newton.refine(u, x[target])
        if not self.redundant:  # where branches meet they change much between neighbouring nodes
            row, across = twins(self.newton, u, _FOLDED, _ACROSS)
            folded = np.unique(target[row])
            owner, wide = self.starts.propose(x[folded], _WIDE)
            owner, more = np.append(target[row], folded[owner]), np.concatenate([across, wide])
            more, left = self.newton.refine(more, x[owner])
            target, u = np.append(target, owner), np.concatenate([u, more])
            distance = np.append(distance, left)
        met = distance <= CLOSE * self.extent
        target, u, distance = self._by_middle(target[met], u[met], distance[met])
        keep = distinct(self.scale, target, u, _SAME)
        return target[keep], u[keep], distance[keep]

    def _by_middle(self, target: Index, u: Array, distance: Array) -> tuple[Index, Array, Array]:
        """Solutions sorted by target and distance to the middle of the ranges."""
        away = np.linalg.norm(self.scale.difference(u, np.full_like(u, 0.5)), axis=1)
        order = np.lexsort((away, target))
        return target[order], u[order], distance[order]

    def clip(self, u: Array) -> Array:
        """Points (n, dof) moved into the unit box; a periodic joint goes round instead."""
        return self.newton.clip(u)
