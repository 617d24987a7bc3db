"""Tasks: what joints have to reach, as residuals of targets and their derivative.

A position of a sensor or of the base frame, a pose, and a pose whose turn about one axis is left
open are the same to a search: it knows `residual`, how many numbers it has, and its size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arm.rotations import exponential, logarithm
from ..common.arrays import Array
from ..common.scale import Scale

#: Position (n, 3) [m], orientation (n, 3, 3) and geometric Jacobian (n, 6, dof) at joints (n, dof).
Evaluate = Callable[[Array], tuple[Array, Array, Array]]


class Task(Protocol):
    """What joints of the unit box have to reach."""

    @property
    def size(self) -> float:
        """A length that residuals are compared with."""
        ...

    @property
    def count(self) -> int:
        """How many numbers a residual has, m."""
        ...

    def residual(self, u: Array, target: Array) -> tuple[Array, Array]:
        """Residuals (n, m) of targets at joints `u` (n, dof), and the Jacobian (n, m, dof)."""
        ...


@dataclass(frozen=True)
class Positions:
    """Positions (n, m) by a forward map that knows its Jacobian."""

    value_and_slope: Callable[[Array], tuple[Array, Array]]
    count: int
    size: float  # the extent of what can be reached

    @staticmethod
    def in_base(evaluate: Evaluate, scale: Scale, length: float) -> Positions:
        """Positions [m] of a chain of some length [m] in its base frame."""

        def value_and_slope(u: Array) -> tuple[Array, Array]:
            q = scale.from_unit(u)
            place, _, slope = evaluate(q)
            linear = slope[:, :3]
            return place, linear * scale.span

        return Positions(value_and_slope, 3, length)

    def residual(self, u: Array, target: Array) -> tuple[Array, Array]:
        """Residuals (n, m) and the Jacobian (n, m, dof)."""
        value, slope = self.value_and_slope(u)
        return target - value, slope


@dataclass(frozen=True)
class Poses:
    """Positions and orientations of a chain in its base frame, as rows of 3 and 9 numbers."""

    evaluate: Evaluate
    scale: Scale
    lever: float  # [m], what a radian of turn counts as
    size: float  # [m], the arm's length
    # axis of the tip, 0 to 2, about which it may turn freely
    free_axis: int | None = None

    @property
    def count(self) -> int:
        """Six numbers, five where a turn is free."""
        return 6 if self.free_axis is None else 5

    @staticmethod
    def target(position: Array, rotation: Array) -> Array:
        """Targets (n, 12) of positions (n, 3) [m] and orientations (n, 3, 3)."""
        turn = rotation.reshape(-1, 9)
        return np.concatenate([position, turn], axis=1)

    def residual(self, u: Array, target: Array) -> tuple[Array, Array]:
        """Residuals of position and of turn, (n, 6) or (n, 5), and the Jacobian."""
        q = self.scale.from_unit(u)
        place, turn, slope = self.evaluate(q)
        linear = slope[:, :3]
        spin = slope[:, 3:]
        goal_place = target[:, :3]
        goal_turn = target[:, 3:].reshape(-1, 3, 3)
        rest = turn_left(turn, goal_turn, self.free_axis)
        if self.free_axis is not None:  # along the tip's two other axes
            axes = np.swapaxes(turn, 1, 2)
            sides = np.delete(axes, self.free_axis, axis=1)
            rest = (sides @ rest[:, :, None])[:, :, 0]
            spin = sides @ spin
        missing = goal_place - place
        missing_turn = self.lever * rest
        residual = np.concatenate([missing, missing_turn], axis=1)
        angular = self.lever * spin
        slope = np.concatenate([linear, angular], axis=1)
        return residual, slope * self.scale.span


def turn_left(start: Array, goal: Array, axis: int | None) -> Array:
    """Rotation vectors (n, 3) from orientations (n, 3, 3) to others.

    Where the turn about an axis of the tip is free, the others are those nearest to the first: of
    all turns about the axis the one after which ``trace(goal' start)`` is largest.
    """
    if axis is not None:
        i = (axis + 1) % 3
        j = (axis + 2) % 3
        apart = np.swapaxes(goal, 1, 2) @ start
        sine = apart[:, j, i] - apart[:, i, j]
        cosine = apart[:, i, i] + apart[:, j, j]
        angle = np.arctan2(sine, cosine)
        open_axis = np.eye(3)[axis]
        turn = exponential(angle[:, None] * open_axis)
        goal = goal @ turn
    back = np.swapaxes(start, 1, 2)
    return logarithm(goal @ back)
