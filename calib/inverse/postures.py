"""Postures: joints from which every way to a pose is reached."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..common.arrays import Array, Index
from ..common.scale import TURN, Scale
from .closed_form import ClosedForm
from .settings import SEARCH
from .task import Evaluate
from .ways import drawn_joints

if TYPE_CHECKING:
    from scipy.spatial import KDTree

_ASIDE = 0.1  # [rad] by which the drawing's joints may lie beyond the limits


@dataclass(frozen=True)
class Postures:
    """A table of postures all over the joints' ranges, those nearest to a pose first."""

    evaluate: Evaluate
    scale: Scale
    length: float  # [m], of the arm: a radian of turn counts as much
    columns: tuple[int, ...]  # of a pose (12,), those that a target asks for
    apart: ClassVar[float] = SEARCH.apart

    def of(self, x: Array) -> tuple[Index, Array]:
        """The postures nearest to places (n, 3) or poses (n, 12)."""
        features = self._features(x)
        _, rows = self._tree.query(features, SEARCH.nearest)
        targets = np.arange(len(x))
        owner = np.repeat(targets, SEARCH.nearest)
        return owner, self._u[rows.ravel()]

    @cached_property
    def _u(self) -> Array:
        """Joints (k, dof) of the unit box."""
        return drawn_joints(SEARCH.postures, len(self.scale.span))

    @cached_property
    def _tree(self) -> KDTree:
        from scipy.spatial import KDTree

        q = self.scale.from_unit(self._u)
        place, turn, _ = self.evaluate(q)
        numbers = turn.reshape(-1, 9)
        poses = np.concatenate([place, numbers], axis=1)
        return KDTree(self._features(poses))

    def _features(self, x: Array) -> Array:
        place = x[:, :3] / self.length
        # the distance of matrices is that of angles
        turn = x[:, 3:] / np.sqrt(2)
        features = np.concatenate([place, turn], axis=1)
        return features[:, self.columns]


@dataclass(frozen=True)
class DrawnPostures:
    """Postures by the closed form of the drawing, whose ways are nearly those of the arm."""

    closed: ClosedForm
    scale: Scale
    # (6,) each: the drawing's joints are gain q + offset
    gain: Array
    offset: Array
    apart: ClassVar[float] = SEARCH.same

    def of(self, x: Array) -> tuple[Index, Array]:
        """Joints of every way to poses (n, 12), without those beyond the limits."""
        place = x[:, :3]
        turn = x[:, 3:].reshape(-1, 3, 3)
        values = self.closed.joints(place, turn)
        q = (values - self.offset) / self.gain
        lower = self.scale.lower
        half = 0.5 * self.scale.span
        middle = lower + half
        turns = np.round((q - middle) / TURN)
        q = q - TURN * turns
        beyond = np.abs(q - middle) > half + _ASIDE
        inside = ~beyond.any(axis=2)
        target, way = np.nonzero(inside)
        u = (q[target, way] - lower) / self.scale.span
        return target, np.clip(u, 0.0, 1.0)
