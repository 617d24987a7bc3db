"""Error scale: how errors become colours and words, for colour-blind eyes, noise-free ones too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.wording import ROUNDED_AWAY, number, unit_for

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
