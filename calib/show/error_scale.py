"""Error scale: how errors become colours, shades and words, noise-free ones included."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDING = 1e-9
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
    if abs(value) < ROUNDING:
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
        least = ROUNDING if unit == "m" else ROUNDING * extent
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
