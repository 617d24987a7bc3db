"""Tasks: what joints are asked for: residuals of rows of targets, and their derivative.

A task of the base frame or of a sensor, with an orientation or without, is the same to a search:
it knows `value_and_slope` and `gap`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arm.rotations import logarithm
from ..common.arrays import Array
from ..common.scale import Scale

#: Position (n, 3) [m], orientation (n, 3, 3) and geometric Jacobian (n, 6, dof) at joints (n, dof).
Evaluate = Callable[[Array], tuple[Array, Array, Array]]


class Task(Protocol):
    """Targets are rows (n, k), residuals have m numbers."""

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """What is reached (n, k), and how residuals shrink with unit coordinates (n, m, dof)."""
        ...

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, m) between targets and what is reached."""
        ...


@dataclass(frozen=True)
class Positions:
    """Positions (n, m) by a forward map that knows its Jacobian."""

    value_and_slope: Callable[[Array], tuple[Array, Array]]

    @staticmethod
    def in_base(evaluate: Evaluate, scale: Scale) -> Positions:
        """Positions of a chain in its base frame [m]."""

        def value_and_slope(u: Array) -> tuple[Array, Array]:
            place, _, slope = evaluate(scale.from_unit(u))
            return place, slope[:, :3] * scale.span

        return Positions(value_and_slope)

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, m)."""
        return target - value


@dataclass(frozen=True)
class Poses:
    """Positions and orientations of a chain in its base frame, as rows of 3 and 9 numbers."""

    evaluate: Evaluate
    scale: Scale
    lever: float  # [m], what a radian of turn counts as
    free: int | None = (
        None  # axis of the tip, 0 to 2, about which its turn is left open
    )

    @staticmethod
    def target(position: Array, rotation: Array) -> Array:
        """Targets (n, 12) of positions (n, 3) [m] and orientations (n, 3, 3)."""
        return np.concatenate([position, rotation.reshape(-1, 9)], axis=1)

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Poses (n, 12), and how residuals shrink with the unit coordinates (n, m, dof)."""
        place, turn, slope = self.evaluate(self.scale.from_unit(u))
        slope = slope * self.scale.span
        slope[:, 3:] *= self.lever
        if self.free is not None:
            sides = np.swapaxes(turn, 1, 2)[:, self._sides]
            slope = np.concatenate([slope[:, :3], sides @ slope[:, 3:]], axis=1)
        return self.target(place, turn), slope

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, 6), or (n, 5): of the position, and the lever times the turn left."""
        wanted = target[:, 3:].reshape(-1, 3, 3)
        reached = value[:, 3:].reshape(-1, 3, 3)
        if self.free is None:
            turn = logarithm(wanted @ np.swapaxes(reached, 1, 2))
        else:
            swing = _swing(reached[:, :, self.free], wanted[:, :, self.free])
            sides = np.swapaxes(reached, 1, 2)[:, self._sides]
            turn = (sides @ swing[:, :, None])[:, :, 0]
        return np.concatenate([target[:, :3] - value[:, :3], self.lever * turn], axis=1)

    @property
    def _sides(self) -> list[int]:
        """Axes of the tip across the free one."""
        assert self.free is not None  # noqa: S101
        return [(self.free + 1) % 3, (self.free + 2) % 3]


def _swing(start: Array, goal: Array) -> Array:
    """Rotation vectors (n, 3) across both that turn unit vectors (n, 3) into others."""
    across = np.cross(start, goal)
    sine = np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.arctan2(sine, (start * goal).sum(axis=1, keepdims=True))
    opposite = (sine == 0.0) & (angle > 1.0)
    if opposite.any():
        side = np.cross(
            start, np.column_stack([start[:, 1], start[:, 2], -start[:, 0]])
        )
        across = np.where(opposite, side, across)
        sine = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(across * (angle / np.where(sine > 0.0, sine, 1.0)))
