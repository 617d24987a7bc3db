"""The unit box: every coordinate divided by its range, so that rad, m and pixels never mix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from .arrays import Array, Mask, ReadOnly, Shape

TURN = 2 * np.pi

METRES = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "um": 1e6, "in": 1 / 0.0254}
"""Units per metre of the units that are lengths."""


@dataclass(frozen=True)
class Scale(ReadOnly):
    """An affine map of a box onto [0, 1] along each coordinate."""

    # (d,), lower end and width of the box, in the coordinate's own unit
    lower: Annotated[Array, Shape("d")]
    span: Annotated[Array, Shape("d")]
    # (d,), coordinates whose box is one full turn: its two ends are the same place
    periodic: Annotated[Mask, Shape("d")]

    @staticmethod
    def of_range(
        lower: Array, upper: Array, revolute: tuple[bool, ...]
    ) -> Scale:
        """Scale of joints with these limits; a revolute range of a full turn is periodic."""
        span = upper - lower
        return Scale(
            lower, span, np.asarray(revolute) & (np.abs(span - TURN) < 1e-9)
        )

    @staticmethod
    def of_data(x: Array) -> Scale:
        """Scale of the box that holds the rows of `x` (n, d)."""
        lower = x.min(axis=0)
        span = np.ptp(x, axis=0)
        return Scale(
            lower,
            np.where(span > 0, span, 1.0),
            np.zeros(x.shape[1], dtype=bool),
        )

    @cached_property
    def goes_round(self) -> bool:
        """Whether any coordinate is periodic."""
        return bool(self.periodic.any())

    def to_unit(self, x: Array) -> Array:
        """Coordinates (n, d) in the unit box; periodic ones are wrapped into [0, 1)."""
        with np.errstate(over="ignore"):  # infinitely far outside is outside
            return self.wrapped((x - self.lower) / self.span)

    def from_unit(self, u: Array) -> Array:
        """Coordinates (n, d) of points of the unit box."""
        return self.lower + u * self.span

    def difference(self, u: Array, v: Array) -> Array:
        """U - v in the unit box, the short way round where it is periodic."""
        delta = u - v
        if self.goes_round:
            turns = np.round(delta)
            delta = delta - np.where(self.periodic, turns, 0.0)
        return delta

    def wrapped(self, u: Array) -> Array:
        """Points (n, d) with their periodic coordinates within one turn, [0, 1)."""
        if not self.goes_round:
            return u
        with np.errstate(invalid="ignore"):  # of what is infinitely far
            turned = u % 1.0
        # of -1e-20 the remainder rounds to 1, which a periodic k-d tree refuses
        return np.where(self.periodic, np.where(turned == 1.0, 0.0, turned), u)
