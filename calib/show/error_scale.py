"""Error scale: how errors become colours and words, for colour-blind eyes, noise-free ones too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.wording import ROUNDED_AWAY, for_people
from .settings import LIMITS

_IN_MM = 2e-5  # m, errors from which they are shown in mm
_ROUNDING = 1e-6
_IN_UM = 2e-8  # m, and in micrometres


@dataclass(frozen=True)
class ErrorScale:
    """A scale of errors from low to high [unit], linear or, where `log`, by equal ratios."""

    low: float
    high: float
    log: bool
    unit: str
    empty: bool = (
        False  # whether all errors are rounding, so that there is nothing to tell apart
    )

    @staticmethod
    def of(errors: Array, unit: str, extent: float) -> ErrorScale:
        """Return the scale that shows some errors (n,); `extent` is that of the workspace."""
        finite = errors[np.isfinite(errors)]
        least = ROUNDED_AWAY if unit == "m" else ROUNDED_AWAY * extent
        if not len(finite) or finite.max() < least:
            return ErrorScale(0.0, least, log=False, unit=unit, empty=True)
        low, high = np.maximum(np.quantile(finite, [0.01, 0.99]), least / 10).tolist()
        high = max(high, low * 1.000001)
        log = high / low > LIMITS.logarithmic
        # a linear scale starts at nothing where that costs little contrast
        return ErrorScale(0.0 if not log and low < 0.4 * high else low, high, log, unit)

    def share(self, errors: Array) -> Array:
        """Place of errors on the scale, 0 to 1; NaN stays NaN."""
        ends = np.array([self.low, self.high])
        if self.log:
            errors = np.log(np.maximum(errors, self.low))
            ends = np.log(ends)
        place = np.clip((errors - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)
        return np.asarray(0.0 * place if self.empty else place)

    def ticks(self, count: int = 3) -> list[tuple[float, str]]:
        """Places and words of some ticks, in one unit; a single one where all is rounding."""
        if self.empty:
            few = (
                "below 1 nm"
                if self.unit == "m"
                else f"below {self.high:.2g} {self.unit}"
            )
            return [(0.0, f"{few} everywhere")]
        places = np.linspace(0.0, 1.0, count)
        between = np.geomspace if self.log else np.linspace
        factor, unit = unit_for(self.high, self.unit)
        values = factor * between(self.low, self.high, count)
        return [
            (place, f"{number(value)} {unit}")
            for place, value in zip(places.tolist(), values.tolist(), strict=True)
        ]


def number(value: float) -> str:
    """Return a number with three digits and never an exponent; below a millionth it is 0.

    Examples
    --------
    >>> number(1041.7), number(0.12345)
    ('1040', '0.123')
    """
    rounded = float(f"{value:.3g}") if abs(value) >= _ROUNDING else 0.0
    return np.format_float_positional(rounded, trim="-")


def unit_for(largest: float, unit: str) -> tuple[float, str]:
    """Return the factor from a unit to the one that errors up to `largest` are shown in."""
    if unit == "m" and ROUNDED_AWAY <= largest < _IN_MM:
        return (1e6, "µm") if largest >= _IN_UM else (1e9, "nm")
    return for_people(unit)


# the middle of the "plasma" map (van der Walt and Smith, CC0): its lightness rises evenly,
# and its two ends, which vanish on dark and on light ground, are left out
STOPS = (
    *("#5c01a6", "#7e03a8", "#9c179e", "#b52f8c", "#cc4778"),
    *("#de5f65", "#ed7953", "#f89540", "#fdb42f"),
)
"""Colours at equal steps of the scale, low to high."""

UNKNOWN = "#8b97a3"
"""Nodes that no sample has visited."""


def colours(share: Array) -> NDArray[np.uint8]:
    """Colours (n, 3) of places (n,) on a scale from 0 to 1; NaN is grey."""
    *stops, grey = (list(bytes.fromhex(colour[1:])) for colour in (*STOPS, UNKNOWN))
    at = np.linspace(0.0, 1.0, len(stops))
    mixed = np.stack(
        [np.interp(share, at, part) for part in np.array(stops).T], axis=-1
    )
    return np.round(np.where(np.isfinite(share)[:, None], mixed, grey)).astype(np.uint8)
