"""Inverse: from a position to joints, through the links and the learned forward map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..common.scale import Scale
from ..maps.association import Association
from ..maps.predictor import Predictor
from .closest import closest
from .newton import CLOSE, Newton
from .self_motions import representatives
from .starts import Starts, damped_inverse, twins
from .tasks import Positions

SAME = 1e-5
"""Solutions closer than this share of the joints' range are one."""

_BESIDE = 0.1  # of the sine between the Jacobian's columns: a step so long stays on its branch
_SHORT = 0.03  # of the joints' range: no longer step is taken for one
_ALIKE = 4.0  # node spacings: solutions of redundant joints that are about as close
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
        return Newton(Positions(self.predictor), self.scale, self.extent)

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
        if not self.redundant:
            u, distance = self._from_near(x, near)
            rows = np.flatnonzero(np.isnan(distance))
            if len(rows):
                u[rows], distance[rows] = self._from_starts(x[rows], near[rows])
        else:
            # redundant joints: from the wished ones on; the links where that leads far away
            u, distance = self.newton.settle(self.clip(near), x, near)
            away = np.linalg.norm(self.scale.difference(u, near), axis=1)
            unsure = (distance > CLOSE * self.extent) | (away > _ALIKE * self._spacing)
            rows = np.flatnonzero(unsure)
            if len(rows):
                self.newton.take_better(
                    u, distance, near, rows, *self._from_starts(x[rows], near[rows])
                )
        return self._rescued(u, distance, x, near)

    def _from_near(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Solutions next to the joints wished for; NaN where another branch may be closer.

        Branches meet at folds, where the Jacobian's columns are parallel: the sine between them
        is about the way [rad] to the fold, and the other branch is as far beyond it.
        """
        u, distance = np.full(near.shape, np.nan), np.full(len(near), np.nan)
        if near.shape[1] != x.shape[1]:
            return u, distance
        value, slope = self.predictor.value_and_slope(near)
        size = np.sqrt((slope * slope).sum(axis=1)).prod(axis=1)
        sine = np.abs(np.linalg.det(slope)) / np.maximum(size, 1e-300)
        room = np.minimum(_BESIDE * sine, _SHORT)
        step = np.einsum("ndm,nm->nd", damped_inverse(slope, 1e-12), x - value)
        rows = np.flatnonzero(np.abs(step).max(axis=1) < room)
        found, found_distance = self.newton.refine(near[rows], x[rows])
        gap = np.abs(self.scale.difference(found, near[rows])).max(axis=1)
        sure = (found_distance <= CLOSE * self.extent) & (gap < 2.0 * room[rows])
        u[rows[sure]], distance[rows[sure]] = found[sure], found_distance[sure]
        return u, distance

    def _from_starts(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Solutions from the starts that are closest to the joints wished for."""
        start, step, folded = self.starts.of(x)
        n, dof, outputs = start.shape[0], start.shape[2], x.shape[1]
        gap = self.scale.difference(start, near[:, None])
        away = np.sqrt((gap * gap).sum(axis=2))
        away[np.isnan(away)] = np.inf
        rows = np.arange(n)
        first = away.argmin(axis=1)
        u, distance = self.newton.settle(start[rows, first], x, near)
        # others that may lead closer, because a start is not yet a solution; all where it missed
        doubt = 1.0 + step[rows, first][:, None] + step if dof <= outputs else _ALIKE
        other = away < away[rows, first][:, None] + self._spacing * doubt
        other |= (distance > CLOSE * self.extent)[:, None] & np.isfinite(away)
        other[rows, first] = False
        row, column = np.nonzero(other)
        if len(row):
            found = self.newton.settle(start[row, column], x[row], near[row])
            self.newton.take_better(u, distance, near, row, *found)
        folds = np.flatnonzero(folded)
        if len(folds):
            row, twin = twins(self.newton, u[folds])
            owner = folds[row]
            found = self.newton.refine(twin, x[owner])
            self.newton.take_better(u, distance, near, owner, *found)
        return u, distance

    @property
    def _spacing(self) -> float:
        return self.association.motor.spacing

    def _rescued(self, u: Array, distance: Array, x: Array, near: Array) -> tuple[Array, Array]:
        """Answers whose targets were missed, tried again from more places."""
        missed = np.flatnonzero(distance > CLOSE * self.extent)
        if len(missed):
            starts = self.starts
            for target, start in (starts.propose(x[missed], _WIDE), starts.around(x[missed])):
                row = missed[target]
                found = self.newton.settle(start, x[row], near[row])
                self.newton.take_better(u, distance, near, row, *found)
            missed = np.flatnonzero(distance > CLOSE * self.extent)
            u[missed], distance[missed] = closest(self.newton, u[missed], x[missed])
        return u, distance

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
        start, _, folded = self.starts.of(x)
        target, column = np.nonzero(~np.isnan(start[..., 0]))
        u = start[target, column]
        if folded.any():
            # where branches meet they can change much between neighbouring nodes
            row, more = self.starts.propose(x[folded], _WIDE)
            target, u = np.append(target, np.flatnonzero(folded)[row]), np.concatenate([u, more])
        if u.shape[1] >= x.shape[1] + _MANY:
            drawn = np.random.default_rng(0).random((_DRAWN, u.shape[1]))
            target = np.append(target, np.repeat(np.arange(len(x)), _DRAWN))
            u = np.concatenate([u, np.tile(drawn, (len(x), 1))])
        u, distance = self.newton.refine(u, x[target])
        if not self.redundant:
            row, other = twins(self.newton, u)
            other, other_distance = self.newton.refine(other, x[target[row]])
            target = np.concatenate([target, target[row]])
            u, distance = np.concatenate([u, other]), np.concatenate([distance, other_distance])
        met = distance <= CLOSE * self.extent
        target, u, distance = self._by_middle(target[met], u[met], distance[met])
        keep = self._distinct(target, u)
        return target[keep], u[keep], distance[keep]

    def _by_middle(self, target: Index, u: Array, distance: Array) -> tuple[Index, Array, Array]:
        """Solutions sorted by target and distance to the middle of the ranges."""
        away = np.linalg.norm(self.scale.difference(u, np.full_like(u, 0.5)), axis=1)
        order = np.lexsort((away, target))
        return target[order], u[order], distance[order]

    def _distinct(self, target: Index, u: Array) -> NDArray[np.bool_]:
        """Which solutions, sorted by target, repeat no earlier one of the same target."""
        keep = np.ones(len(u), dtype=bool)
        most = int(np.bincount(target).max(initial=0))
        for lag in range(1, most):
            same = np.flatnonzero(target[lag:] == target[:-lag])
            gap = np.abs(self.scale.difference(u[same + lag], u[same])).max(axis=1)
            keep[same[gap < SAME] + lag] = False
        return keep

    def clip(self, u: Array) -> Array:
        """Points (n, dof) moved into the unit box; a periodic joint goes round instead."""
        return self.newton.clip(u)
