"""Alignment: what an affine map of the sensor's frame is, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arm.rotations import logarithm, nearest_rotation
from ..common.arrays import Array
from ..common.wording import number, quantity


@dataclass(frozen=True)
class Alignment:
    """An affine map x' = A x + b of positions."""

    matrix: Array  # (m, m), A, of a plane or of space
    shift: Array  # (m,) [unit], b

    @staticmethod
    def between(old: Array, new: Array) -> Alignment:
        """The least-squares map from `old` (n, m) to `new` (n, m)."""
        middle = old.mean(axis=0)
        target = new.mean(axis=0)
        matrix = np.linalg.lstsq(old - middle, new - target, rcond=None)[0].T
        return Alignment(matrix, target - matrix @ middle)

    def apply(self, x: Array) -> Array:
        """Map positions (n, m)."""
        return x @ self.matrix.T + self.shift

    def inverse(self) -> Alignment:
        """The map back."""
        back = np.asarray(np.linalg.inv(self.matrix), dtype=float)
        return Alignment(back, -back @ self.shift)

    @property
    def scale(self) -> float:
        """Factor of lengths, by the area or the volume."""
        return float(abs(np.linalg.det(self.matrix)) ** (1 / len(self.shift)))

    @property
    def is_mirrored(self) -> bool:
        """Whether the sense of turning is reversed."""
        return float(np.linalg.det(self.matrix)) < 0

    @property
    def is_swapped(self) -> bool:
        """Whether x and y are exchanged."""
        turned = np.abs(self.matrix / max(self.scale, 1e-300))
        return self.is_mirrored and bool(
            np.min([turned[0, 1], turned[1, 0]]) > 0.9
        )

    @property
    def angle(self) -> float:
        """Rotation [rad], after a mirror of x where there is one; in space without its sign."""
        axes = len(self.matrix)
        turned = np.eye(3)
        turned[:axes, :axes] = self.matrix
        turned[:, 0] *= -1.0 if self.is_mirrored else 1.0
        turn = logarithm(nearest_rotation(turned)[None])[0]
        return float(turn[2] if axes == 2 else np.linalg.norm(turn))

    def words(
        self,
        unit: str,
        turn_half: float = 0.0,
        shift_half: Array | float = 0.0,
    ) -> str:
        """The whole map in words.

        turn_half, shift_half : halves of 95 % intervals, where they are known, of the rotation
            [rad] and of the shift, (m,) [unit]
        """
        halves = np.broadcast_to(shift_half, self.shift.shape)
        parts = [f"turned {quantity(self.angle, 'rad', turn_half)}"]
        if self.is_mirrored:
            parts.insert(0, "mirrored")
        scale = number(self.scale, 4)
        if scale != "1":
            parts.append(f"scaled {scale}")
        shifts = [
            quantity(shift, unit, half)
            for shift, half in zip(self.shift, halves, strict=True)
        ]
        parts.append(f"shifted {', '.join(shifts)}")
        return ", ".join(parts)

    def to_json(self) -> list[list[float]]:
        """Rows of [A | b]."""
        rows: list[list[float]] = np.column_stack(
            [self.matrix, self.shift]
        ).tolist()
        return rows

    @classmethod
    def from_json(cls, rows: list[list[float]]) -> Alignment:
        """Rebuild what `to_json` returned."""
        table = np.array(rows, dtype=float)
        return cls(table[:, :-1], table[:, -1])
