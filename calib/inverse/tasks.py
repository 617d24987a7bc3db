"""Tasks: what joints are asked to reach, what is left of it, and how that changes with them."""

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
    """What engines know of a question: targets are rows (n, k), residuals have m numbers."""

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

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, m)."""
        return target - value

    @staticmethod
    def of_chain(evaluate: Evaluate, scale: Scale) -> Positions:
        """Positions (n, 3) [m] of a chain in its base frame."""

        def value_and_slope(u: Array) -> tuple[Array, Array]:
            place, _, slope = evaluate(scale.from_unit(u))
            return place, slope[:, :3] * scale.span

        return Positions(value_and_slope)


@dataclass(frozen=True)
class Poses:
    """Positions and orientations of a chain in its base frame, as rows of 3 and 9 numbers."""

    evaluate: Evaluate
    scale: Scale
    lever: float  # [m], what a radian of turn counts as

    @staticmethod
    def target(position: Array, rotation: Array) -> Array:
        """Targets (n, 12) of positions (n, 3) [m] and orientations (n, 3, 3)."""
        return np.concatenate([position, rotation.reshape(-1, 9)], axis=1)

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Poses (n, 12), and how residuals shrink with the unit coordinates (n, 6, dof)."""
        place, turn, slope = self.evaluate(self.scale.from_unit(u))
        slope = slope * self.scale.span
        slope[:, 3:] *= self.lever
        return self.target(place, turn), slope

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, 6): of the position, and the lever times the turn that is left."""
        wanted, reached = (part[:, 3:].reshape(-1, 3, 3) for part in (target, value))
        turn = logarithm(wanted @ np.swapaxes(reached, 1, 2))
        return np.concatenate([target[:, :3] - value[:, :3], self.lever * turn], axis=1)
