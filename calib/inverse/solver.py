"""Solver: joints for positions, through the links and the learned forward map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common.arrays import Array, Index
from ..common.scale import Scale
from ..maps.association import Association
from ..maps.predictor import Predictor
from .closest import closest
from .families import representatives
from .links import LinkStarts
from .newton import Newton
from .search import Search, by_middle
from .settings import SEARCH
from .task import Positions


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
        return self.newton.redundant

    @property
    def scale(self) -> Scale:
        """Range of the joints."""
        return self.association.motor.scale

    @cached_property
    def newton(self) -> Newton:
        """Damped steps towards a target."""
        outputs = self.association.sensory.units.shape[1]
        task = Positions(self.predictor.value_and_slope, outputs, self.extent)
        return Newton(task, self.scale)

    @cached_property
    def search(self) -> Search:
        """The search from where the links say that a solution may be."""
        sure = SEARCH.surely if self.redundant else SEARCH.beside
        return Search(
            self.newton, LinkStarts(self.association, self.newton), sure
        )

    def solve(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) for targets `x` (n, m) nearest to `near` (n, dof), what is missing (n,).

        Joints are in the unit box; out of reach they are those of the nearest attainable point.
        """
        u, miss = self.search.nearest(x, near)
        lost = np.flatnonzero(~self.newton.met(miss))
        if len(lost):
            u[lost], miss[lost] = closest(self.newton, u[lost], x[lost])
        return u, miss

    def solve_all(self, x: Array) -> tuple[Index, Array, Array]:
        """Every distinct solution of targets (n, m): of which it is, joints (k, dof), distance.

        Sorted by target, the one nearest to the middle of the unit box first.  Of redundant joints
        each connected family has one; out of reach there is one, the nearest attainable point.
        """
        target, u, miss = self.search.every(x)
        if self.redundant and len(u):
            target, u = representatives(self.newton, target, u, x)
            miss = np.linalg.norm(self.predictor.value(u) - x[target], axis=1)
        lost = np.setdiff1d(np.arange(len(x)), target)
        if len(lost):
            middle = np.full((len(lost), u.shape[1]), 0.5)
            nearest, missing = self.solve(x[lost], middle)
            target = np.concatenate([target, lost])
            u = np.concatenate([u, nearest])
            miss = np.concatenate([miss, missing])
        return by_middle(self.scale, target, u, miss)
