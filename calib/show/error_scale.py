"""Error scale: how errors become colours and words, for colour-blind eyes, noise-free ones too."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array

ROUNDED_AWAY = 1e-9
"""Errors below this [m], or below this share of a sensor's extent, are rounding."""

_PREFIXES = ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm"))
_WIDE = 20.0  # a ratio of errors beyond which the scale is logarithmic


def length_in_words(value: float, unit: str) -> str:
    """Return a length with the prefix that suits it, three digits.

    Examples
    --------
    >>> length_in_words(0.00123, "m"), length_in_words(3e-13, "m"), length_in_words(2.5, "px")
    ('1.23 mm', 'below 1 nm', '2.5 px')
    """
    if not math.isfinite(value):
        return "unknown"
    if unit != "m":
        return f"{value:.3g} {unit}"
    if value == 0:
        return "0"
    if abs(value) < ROUNDED_AWAY:
        return "below 1 nm"
    factor, name = next(
        ((f, n) for f, n in _PREFIXES[1:] if abs(value) >= 0.9995 * f), _PREFIXES[-1]
    )
    if abs(value) >= 1.0:
        factor, name = _PREFIXES[0]
    return f"{value / factor:.3g} {name}"


@dataclass(frozen=True)
class ErrorScale:
    """A scale of errors from low to high, linear or logarithmic."""

    # [unit], its two ends
    low: float
    high: float
    log: bool  # whether equal steps are equal ratios
    unit: str  # unit of the errors
    rounding: bool  # whether all of it is rounding, so that there is nothing to tell apart

    @staticmethod
    def of(errors: Array, unit: str, extent: float) -> ErrorScale:
        """Return the scale that shows some errors; `extent` is that of the workspace."""
        known = errors[np.isfinite(errors)]
        least = ROUNDED_AWAY if unit == "m" else ROUNDED_AWAY * extent
        if not len(known) or known.max() < least:
            return ErrorScale(0.0, least, False, unit, True)
        low, high = (float(v) for v in np.quantile(known, [0.01, 0.99]))
        low = max(low, least / 10)
        high = max(high, low * 1.000001)
        if high / low > _WIDE:
            return ErrorScale(low, high, True, unit, False)
        # a linear scale starts at nothing where that costs little contrast
        low = 0.0 if low < 0.4 * high else low
        return ErrorScale(low, high, False, unit, False)

    def share(self, errors: Array) -> Array:
        """Place of errors on the scale, 0 to 1; 0 where all is rounding, NaN stays NaN."""
        errors = np.asarray(errors, dtype=float)
        if self.rounding:
            return np.where(np.isfinite(errors), 0.0, np.nan)
        if self.log:
            floor = np.maximum(errors, self.low * 1e-3)  # the logarithm of nothing is clipped
            place = np.log(floor / self.low) / math.log(self.high / self.low)
        else:
            place = (errors - self.low) / (self.high - self.low)
        return np.asarray(np.clip(place, 0.0, 1.0))

    def value(self, share: float) -> float:
        """Error at a place of the scale; the inverse of :meth:`share`."""
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)

    def ticks(self, count: int = 3) -> list[tuple[float, str]]:
        """Places and words of some ticks; a single one where all is rounding."""
        if self.rounding:
            return [(0.0, self.words())]
        places = np.linspace(0.0, 1.0, count)
        return [(float(p), length_in_words(self.value(float(p)), self.unit)) for p in places]

    def words(self) -> str:
        """Return the range in words."""
        if self.rounding:
            few = "below 1 nm" if self.unit == "m" else f"below {self.high:.2g} {self.unit}"
            return f"{few} everywhere"
        return f"{length_in_words(self.low, self.unit)} to {length_in_words(self.high, self.unit)}"


# the middle of the "plasma" map (van der Walt and Smith, CC0): its lightness rises evenly,
# and its two ends, which vanish on dark and on light ground, are left out
STOPS = (
    *("#5c01a6", "#7e03a8", "#9c179e", "#b52f8c", "#cc4778"),
    *("#de5f65", "#ed7953", "#f89540", "#fdb42f"),
)
"""Colours at equal steps of the scale, low to high."""

UNKNOWN = "#8b97a3"
"""Nodes that no sample has visited."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour such as ``#5c01a6``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def colours(share: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours (n, 3) of places (n,) on a scale from 0 to 1; NaN is grey."""
    stops = np.array([rgb(c) for c in STOPS], dtype=float)
    place = np.where(np.isfinite(share), share, 0.0) * (len(stops) - 1)
    mixed = [np.interp(place, np.arange(len(stops)), stops[:, k]) for k in range(3)]
    mixed = [np.where(np.isfinite(share), m, u) for m, u in zip(mixed, rgb(UNKNOWN), strict=True)]
    return np.round(np.stack(mixed, axis=-1)).astype(np.uint8)
