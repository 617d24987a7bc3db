"""Error scale: how errors become colours and words, for colour-blind eyes, noise-free ones too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.wording import ROUNDED_AWAY, length_in_words

_WIDE = 20.0  # a ratio of errors beyond which the scale is logarithmic


@dataclass(frozen=True)
class ErrorScale:
    """A scale of errors from low to high [unit], linear or, where `log`, by equal ratios."""

    low: float
    high: float
    log: bool
    unit: str
    empty: bool = False  # whether all errors are rounding, so that there is nothing to tell apart

    @staticmethod
    def of(errors: Array, unit: str, extent: float) -> ErrorScale:
        """Return the scale that shows some errors (n,); `extent` is that of the workspace."""
        known, least = errors[np.isfinite(errors)], ROUNDED_AWAY * (1.0 if unit == "m" else extent)
        if not len(known) or known.max() < least:
            return ErrorScale(0.0, least, log=False, unit=unit, empty=True)
        low, high = np.maximum(np.quantile(known, [0.01, 0.99]), least / 10).tolist()
        high = max(high, low * 1.000001)
        log = high / low > _WIDE
        # a linear scale starts at nothing where that costs little contrast
        return ErrorScale(0.0 if not log and low < 0.4 * high else low, high, log, unit)

    def share(self, errors: Array) -> Array:
        """Place of errors on the scale, 0 to 1; NaN stays NaN."""
        ends = np.array([self.low, self.high])
        if self.log:
            errors, ends = np.log(np.maximum(errors, self.low)), np.log(ends)
        place = np.clip((errors - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)
        return np.asarray(0.0 * place if self.empty else place)

    def ticks(self, count: int = 3) -> list[tuple[float, str]]:
        """Places and words of some ticks; a single one where all is rounding."""
        if self.empty:
            few = "below 1 nm" if self.unit == "m" else f"below {self.high:.2g} {self.unit}"
            return [(0.0, f"{few} everywhere")]
        places = np.linspace(0.0, 1.0, count)
        between = np.geomspace if self.log else np.linspace
        values = between(self.low, self.high, count)
        return [
            (float(p), length_in_words(float(v), self.unit))
            for p, v in zip(places, values, strict=True)
        ]


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
    mixed = np.stack([np.interp(share, at, part) for part in np.array(stops).T], axis=-1)
    return np.round(np.where(np.isfinite(share)[:, None], mixed, grey)).astype(np.uint8)
