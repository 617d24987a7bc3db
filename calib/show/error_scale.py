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

    @staticmethod
    def of(errors: Array, unit: str, extent: float) -> ErrorScale:
        """Return the scale that shows some errors (n,); `extent` is that of the workspace."""
        finite = errors[np.isfinite(errors)]
        largest = float(np.quantile(finite, 0.99)) if len(finite) else 0.0
        # below, all is rounding and has one colour
        return ErrorScale(max(largest, ROUNDED_AWAY * extent), unit)

    def share(self, errors: Array) -> Array:
        """Place of errors on the scale, 0 to 1; NaN stays NaN."""
        return np.clip(errors / self.top, 0.0, 1.0)

    def ticks(self) -> list[tuple[float, str]]:
        """Places and words of three ticks, in one unit."""
        factor, unit = unit_for(self.top, self.unit)
        return [
            (share, f"{number(share * factor * self.top)} {unit}")
            for share in (0.0, 0.5, 1.0)
        ]

    def colours(self, errors: Array) -> NDArray[np.uint8]:
        """Colours (n, 3) of errors (n,); NaN is grey."""
        stops = np.array([list(bytes.fromhex(stop[1:])) for stop in STOPS])
        places = np.linspace(0.0, 1.0, len(stops))
        share = self.share(errors)
        channels = [np.interp(share, places, channel) for channel in stops.T]
        tints = np.round(np.stack(channels, axis=1))
        tints[np.isnan(share)] = list(bytes.fromhex(UNKNOWN[1:]))
        return tints.astype(np.uint8)


def number(value: float, digits: int = 3) -> str:
    """Return a number with three digits and never an exponent; below a millionth it is 0.

    Examples
    --------
    >>> number(1041.7), number(0.12345)
    ('1040', '0.123')
    """
    rounded = float(f"{value:.{digits}g}") if abs(value) >= 1e-6 else 0.0
    return np.format_float_positional(rounded, trim="-")


def sized(value: float, unit: str, half: float = 0.0) -> str:
    """Return a value in the unit that suits it, with half of its interval if there is one.

    Examples
    --------
    >>> sized(0.00012345, "m"), sized(0.01, "rad", 0.0005), sized(1e-12, "m")
    ('0.123 mm', '0.573 ± 0.029 deg', 'below 1 nm')
    """
    if unit == "m" and abs(value) + half < ROUNDED_AWAY:
        return "below 1 nm"
    factor, shown = unit_for(abs(value) + half, unit)
    interval = f" ± {number(factor * half, 2)}" if half else ""
    return f"{number(factor * value)}{interval} {shown}"


def unit_for(largest: float, unit: str) -> tuple[float, str]:
    """Return the factor from a unit to the one that errors up to `largest` are shown in."""
    if unit == "1":
        return 100.0, "%"
    if unit == "m" and largest < 2e-8:
        return 1e9, "nm"
    if unit == "m" and largest < 2e-5:
        return 1e6, "µm"
    return for_people(unit)
