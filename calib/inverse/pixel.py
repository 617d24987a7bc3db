"""Pixels: where in the arm's base frame a pixel lies that is known to be on a plane."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from ..errors import QueryError

_STEPS = 30


def undistorted(pixels: Array, lens: Array) -> Array:
    """Directions (n, 2) as x/z, y/z of pixels (n, 2) seen through a lens (f, u0, v0, k1).

    Raises QueryError where the lens folds over: no direction gives that pixel.
    """
    f, u0, v0, k1 = lens
    bent = (pixels - (u0, v0)) / f
    radius = np.linalg.norm(bent, axis=1)
    # r (1 + k1 r^2) = radius by Newton's rule from r = radius
    r = radius.copy()
    for _ in range(_STEPS):
        seen, slope = r * (1 + k1 * r * r), 1 + 3 * k1 * r * r
        r = r - (seen - radius) / np.where(np.abs(slope) > 1e-6, slope, 1e-6)
    seen, slope = r * (1 + k1 * r * r), 1 + 3 * k1 * r * r
    bad = (slope <= 0) | (np.abs(seen - radius) > 1e-9)
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise QueryError(
            f"pixel {pixels[row].round(1).tolist()} of row {row} lies beyond what a lens of "
            f"k1 {k1:.3g} can show: expected one nearer to ({u0:.0f}, {v0:.0f})"
        )
    return np.asarray(bent * (r / np.where(radius > 0, radius, 1.0))[:, None])


def on_plane(
    pixels: Array,
    rotation: Array,
    shift: Array,
    lens: Array,
    normal: Array,
    offset: float,
) -> Array:
    """Points (n, 3) [m] of the plane ``normal @ point = offset`` that are seen at pixels (n, 2).

    The camera sees ``rotation @ point + shift`` [m] through a `lens` (f, u0, v0, k1).
    NaN where the line of sight does not meet the plane in front of the camera.
    """
    ideal = undistorted(np.asarray(pixels, dtype=float), lens)
    rays = np.column_stack([ideal, np.ones(len(ideal))]) @ rotation
    eye = -rotation.T @ shift
    towards = rays @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (offset - float(normal @ eye)) / towards
    depth = np.where((depth > 0) & np.isfinite(depth), depth, np.nan)
    return np.asarray(eye + depth[:, None] * rays)
