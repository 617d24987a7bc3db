"""Colours that tell errors apart, for colour-blind eyes, on light and on dark ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# the middle of the "plasma" map (van der Walt and Smith, CC0): its lightness rises evenly,
# and its two ends, which vanish on dark and on light ground, are left out
_STOPS = (
    "#5c01a6",
    "#7e03a8",
    "#9c179e",
    "#b52f8c",
    "#cc4778",
    "#de5f65",
    "#ed7953",
    "#f89540",
    "#fdb42f",
)

UNKNOWN = "#8b97a3"
"""Nodes that no sample has visited."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour such as ``#5c01a6``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def colours(share: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours (n, 3) of places (n,) on a scale from 0 to 1; NaN is grey."""
    stops = np.array([rgb(c) for c in _STOPS], dtype=float)
    place = np.where(np.isfinite(share), share, 0.0) * (len(stops) - 1)
    mixed = [np.interp(place, np.arange(len(stops)), stops[:, k]) for k in range(3)]
    mixed = [np.where(np.isfinite(share), m, u) for m, u in zip(mixed, rgb(UNKNOWN), strict=True)]
    return np.round(np.stack(mixed, axis=-1)).astype(np.uint8)


def stops() -> tuple[str, ...]:
    """Colours at equal steps of the scale, low to high."""
    return _STOPS
