"""The sides of a printed square to a few hundredths of a pixel: one line fitted to each.

Points of a side are the centroids of the grey level's gradient along the side's normal. A
corner is where two sides cross, the middle where the diagonals cross: perspective keeps both,
and it does not keep the mean of the corners.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .opencv import opencv

Array = NDArray[np.float64]

_POINTS = 31  # along each side
_STEP = 0.25  # between samples of the grey level along a normal [px]
_ENDS = 0.09  # share of a side that is left out at each end: corners are round
_BLUR = 0.6  # [px]


def refine_square(
    grey: NDArray[np.uint8], corners: Array, cells: int = 8
) -> tuple[Array, float, float]:
    """Fit lines to the four sides of a dark square on white, and cross them.

    Parameters
    ----------
    corners : (4, 2) array [px]
        Corners within a pixel or so, in their order around the square.
    cells : int
        Cells along a side, border included: a profile stays within half of one.

    Returns
    -------
    corners : (4, 2) array [px]
        The refined corners, in the same order.
    roughness, width : float [px]
        Of the worst side: rms distance of its points from its line, and the standard deviation
        of the blurred edge across it.
    """
    part, low = blurred_part(grey, corners)
    c = corners - low
    side = float(np.linalg.norm(np.roll(c, -1, 0) - c, axis=1).min())
    reach = float(np.clip(0.6 * side / cells, 1.5, 4.0))
    along = np.linspace(_ENDS, 1.0 - _ENDS, _POINTS)[:, None]
    roughness = width = 0.0
    for _ in range(2):
        ahead = np.roll(c, -1, 0) - c
        points, spread = edge_points(part, c[:, None] + along * ahead[:, None], ahead, reach)
        lines, rough = zip(*map(_line, points), strict=True)
        roughness, width = max(rough), float(np.median(spread, axis=1).max())
        crossed = np.cross(np.roll(lines, 1, axis=0), lines)
        with np.errstate(divide="ignore", invalid="ignore"):
            c = crossed[:, :2] / crossed[:, 2:]
        if not np.isfinite(c).all():
            return corners, np.inf, np.inf
    return c + low, roughness, width


def blurred_part(grey: NDArray[np.uint8], points: Array) -> tuple[NDArray[np.float32], Array]:
    """Return the part of a picture around points, a little blurred, and its corner [px]."""
    low = np.maximum(np.floor(points.min(0)).astype(int) - 12, 0)
    high = np.ceil(points.max(0)).astype(int) + 13
    part = opencv().GaussianBlur(grey[low[1] : high[1], low[0] : high[0]], (0, 0), _BLUR)
    return part.astype(np.float32), low.astype(float)


def edge_points(
    part: NDArray[np.float32], base: Array, ahead: Array, reach: float
) -> tuple[Array, Array]:
    """Move points near straight edges onto them.

    Parameters
    ----------
    base, ahead : (k, n, 2) array [px], (k, 2) array
        Points near each of k edges, and the edges' directions.
    reach : float [px]
        How far to look on either side.

    Returns
    -------
    points, spread : (k, n, 2), (k, n) array [px]
        Centroids of the gradient along the normals, and its standard deviation: the edge's blur.
    """
    cv2 = opencv()
    k, n = base.shape[:2]
    across = np.arange(-reach, reach + 0.5 * _STEP, _STEP)
    normal = np.stack([-ahead[:, 1], ahead[:, 0]], 1)
    normal /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    places = base[:, :, None] + across[:, None] * normal[:, None, None]
    maps = places.astype(np.float32).reshape(k * n, len(across), 2)
    profile = cv2.remap(
        part, maps[..., 0], maps[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    slope = np.gradient(profile.astype(float), axis=1).reshape(k, n, -1)
    sign = np.sign(np.median(slope.sum(2), axis=1))
    slope = np.maximum(slope * np.where(sign == 0, 1.0, sign)[:, None, None], 0.0)
    slope[slope < 0.25 * slope.max(2, keepdims=True)] = 0.0
    total = np.maximum(slope.sum(2), 1e-6)
    shift = (slope @ across) / total
    spread = np.sqrt(np.maximum((slope @ across**2) / total - shift**2, 0.0))
    return base + shift[..., None] * normal[:, None], spread


def crossing(corners: Array) -> Array:
    """Return where the diagonals of a square cross: its middle under any perspective [px]."""
    a, b, c, d = np.c_[corners - corners[0], np.ones(4)]
    p = np.cross(np.cross(a, c), np.cross(b, d))
    return np.asarray(corners[0] + p[:2] / p[2])


def _line(points: Array) -> tuple[Array, float]:
    """Fit `n . x + c = 0` to points, far ones left out; return (n, c) and the rms distance."""
    keep = np.ones(len(points), bool)
    for _ in range(3):
        middle = points[keep].mean(0)
        normal = np.linalg.svd(points[keep] - middle, full_matrices=False)[2][1]
        distance = np.abs((points - middle) @ normal)
        keep = distance < max(3.7 * float(np.median(distance[keep])), 0.05)
        if keep.sum() < 4:
            return np.array([*normal, -normal @ middle]), np.inf
    return np.array([*normal, -normal @ middle]), float(np.sqrt(np.mean(distance[keep] ** 2)))
