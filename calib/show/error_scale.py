"""Error scale: how errors become colours and words, for colour-blind eyes, noise-free ones too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.wording import ROUNDED_AWAY, for_people

# the middle of the "plasma" map (van der Walt and Smith, CC0): its lightness rises evenly,
# and its two ends, which vanish on dark and on light ground, are left out
STOPS = (
    *("#5c01a6", "#7e03a8", "#9c179e", "#b52f8c", "#cc4778"),
    *("#de5f65", "#ed7953", "#f89540", "#fdb42f"),
)
"""Colours at equal steps of the scale, low to high."""

UNKNOWN = "#8b97a3"
"""Nodes that no sample has visited."""


@dataclass(frozen=True)
class ErrorScale:
    """A scale of errors from 0 to `top` [unit]."""

    top: float
    unit: str
    # whether all errors are rounding, so that there is nothing to tell apart
    empty: bool

    @staticmethod
    def of(errors: Array, unit: str, extent: float) -> ErrorScale:
        """Return the scale that shows some errors (n,); `extent` is that of the workspace."""
        finite = errors[np.isfinite(errors)]
        least = rounding(unit, extent)
        if not len(finite) or finite.max() < least:
            return ErrorScale(least, unit, empty=True)
        top = float(np.quantile(finite, 0.99))
        return ErrorScale(max(top, least), unit, empty=False)

    def share(self, errors: Array) -> Array:
        """Place of errors on the scale, 0 to 1; NaN stays NaN."""
        if self.empty:
            return np.zeros_like(errors)
        return np.clip(errors / self.top, 0.0, 1.0)

    def ticks(self) -> list[tuple[float, str]]:
        """Places and words of three ticks, in one unit; a single one where all is rounding."""
        factor, unit = unit_for(self.top, self.unit)
        if self.empty:
            return [
                (0.0, f"below {number(factor * self.top)} {unit} everywhere")
            ]
        return [
            (share, f"{number(share * factor * self.top)} {unit}")
            for share in (0.0, 0.5, 1.0)
        ]


def rounding(unit: str, extent: float) -> float:
    """Errors [unit] below which all is rounding, in a workspace of this extent."""
    return ROUNDED_AWAY if unit == "m" else ROUNDED_AWAY * extent


def number(value: float, digits: int = 3) -> str:
    """Return a number with three digits and never an exponent; below a millionth it is 0.

    Examples
    --------
    >>> number(1041.7), number(0.12345)
    ('1040', '0.123')
    """
    rounded = float(f"{value:.{digits}g}") if abs(value) >= 1e-6 else 0.0
    return np.format_float_positional(rounded, trim="-")


def unit_for(largest: float, unit: str) -> tuple[float, str]:
    """Return the factor from a unit to the one that errors up to `largest` are shown in."""
    if unit == "m" and largest < 2e-8:
        return 1e9, "nm"
    if unit == "m" and largest < 2e-5:
        return 1e6, "µm"
    return for_people(unit)


def colours(share: Array) -> NDArray[np.uint8]:
    """Colours (n, 3) of places (n,) on a scale from 0 to 1; NaN is grey."""
    stops = np.array([list(bytes.fromhex(colour[1:])) for colour in STOPS])
    grey = list(bytes.fromhex(UNKNOWN[1:]))
    places = np.linspace(0.0, 1.0, len(stops))
    channels = [np.interp(share, places, channel) for channel in stops.T]
    known = np.isfinite(share)[:, None]
    return np.round(np.where(known, np.stack(channels, axis=1), grey)).astype(
        np.uint8
    )
