"""Postures: joints from which every way to a pose is reached."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array, Index
from ..common.scale import TURN, Scale
from .closed_form import ClosedForm
from .settings import SEARCH
from .task import Evaluate

if TYPE_CHECKING:
    from scipy.spatial import KDTree

_NEAREST = 192  # postures that a pose starts from, without compiled C
_ASIDE = 0.1  # [rad] by which the drawing's joints may lie beyond the limits


@dataclass(frozen=True)
class Postures:
    """A table of postures all over the joints' ranges, those nearest to a pose first."""

    evaluate: Evaluate
    scale: Scale
    length: float  # [m], of the arm: a radian of turn counts as much
    columns: tuple[int, ...]  # of a pose (12,), those that a target asks for

    def of(self, x: Array) -> tuple[Index, Array]:
        """The postures nearest to places (n, 3) or poses (n, 12)."""
        row = self._tree.query(self._features(x), _NEAREST)[1]
        owner = np.repeat(np.arange(len(x)), _NEAREST)
        return owner, self._u[row.ravel()]

    @cached_property
    def _u(self) -> Array:
        """Joints (k, dof) of the unit box, evenly: multiples of powers (Roberts 2018)."""
        dof = len(self.scale.span)
        golden = 2.0  # the root of g^(dof + 1) = g + 1
        for _ in range(SEARCH.steps):
            golden = (1.0 + golden) ** (1.0 / (dof + 1))
        shares = golden ** -np.arange(1.0, dof + 1.0)
        count = np.arange(1.0, SEARCH.postures + 1.0)
        return np.asarray((0.5 + count[:, None] * shares) % 1.0)

    @cached_property
    def _tree(self) -> KDTree:
        from scipy.spatial import KDTree

        place, turn, _ = self.evaluate(self.scale.from_unit(self._u))
        poses = np.concatenate([place, turn.reshape(-1, 9)], axis=1)
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

    def of(self, x: Array) -> tuple[Index, Array]:
        """Joints of every way to poses (n, 12), without those beyond the limits."""
        values = self.closed.joints(x[:, :3], x[:, 3:].reshape(-1, 3, 3))
        q = (values - self.offset) / self.gain
        middle = self.scale.lower + 0.5 * self.scale.span
        q = q - TURN * np.round((q - middle) / TURN)
        furthest = 0.5 * self.scale.span + _ASIDE
        beyond = np.abs(q - middle) > furthest
        target, way = np.nonzero(~beyond.any(axis=2))
        u = (q[target, way] - self.scale.lower) / self.scale.span
        return target, np.clip(u, 0.0, 1.0)
