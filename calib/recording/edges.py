"""Edges of printed squares to a few hundredths of a pixel, and the corners where they cross.

Points of an edge are the centroids of the grey level's gradient along its normal. A tag's side
is a line; the middle is where the diagonals cross: perspective keeps both, and not the mean of the
corners. At a board's corner parabolas are fitted to the edges that run a whole square from it: tags
within the squares come near it, so a window about it says little.

OpenCV's own contour and windows, on the pictures of benchmarks/camera.py: tags .093 px, .113 where
blurred (edges .030, .054); positions over a board .21 mm, its lens .06 px (edges .09 mm, .02 px).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Mask
from .opencv import Picture, opencv

_POINTS = 31  # along each side
_STEP = 0.25  # between samples of the grey level along a normal [px]
_ENDS = 0.09  # share of a side that is left out at each end: corners are round
_BLUR = 0.6  # [px]
_LEAST_REACH = 1.3  # [px]; of a profile that still holds an edge
_CLEAR = 1.3  # [px]; the blur of the tags beside an edge
_STRAY = 3.7  # median distances of points from their edge: those further off are left out
_STRAIGHT = (0.35, 2.0)  # rms distance and bend of a board's edge, at most [px]
_ALONG = np.linspace(0.14, 0.82, 14)[:, None]  # of a square: near a corner edges are round


def refine_square(grey: Picture, corners: Array, cells: int = 8) -> tuple[Array, float]:
    """Fit lines to the four sides of a dark square on white, and cross them.

    corners : (4, 2) array [px]; corners within a pixel or so, in their order around the square.
    cells : int; cells along a side, border included: a profile stays within half of one.
    Returns corners : (4, 2) array [px]; the refined corners, in the same order.
    Returns roughness : float [px]; rms distance of the worst side's points from its line.
    """
    part, low = _blurred_part(grey, corners)
    c = corners - low
    side = float(np.linalg.norm(np.roll(c, -1, 0) - c, axis=1).min())
    reach = float(np.clip(0.6 * side / cells, 1.5, 4.0))
    along = np.linspace(_ENDS, 1.0 - _ENDS, _POINTS)[:, None]
    roughness = 0.0
    for _ in range(2):
        ahead = np.roll(c, -1, 0) - c
        points, _ = _edge_points(part, c[:, None] + along * ahead[:, None], ahead, reach)
        fitted = [
            _fitted(p, at, on, 1, _POINTS) for p, at, on in zip(points, c, ahead, strict=True)
        ]
        sides = [side for side in fitted if side is not None]
        if len(sides) < 4:
            return corners, np.inf
        roughness = max(side.rough for side in sides)
        c = np.array([_cross(sides[k - 1], sides[k]) for k in range(4)])
    return c + low, roughness


def _blurred_part(grey: Picture, points: Array) -> tuple[NDArray[np.float32], Array]:
    """Return the part of a picture around points, a little blurred, and its corner [px]."""
    low = np.maximum(np.floor(points.min(0)).astype(int) - 12, 0)
    high = np.ceil(points.max(0)).astype(int) + 13
    part = opencv().GaussianBlur(grey[low[1] : high[1], low[0] : high[0]], (0, 0), _BLUR)
    return part.astype(np.float32), low.astype(float)


def _edge_points(
    part: NDArray[np.float32], base: Array, ahead: Array, reach: float
) -> tuple[Array, Array]:
    """Move points near straight edges onto them.

    base, ahead : (k, n, 2) array [px], (k, 2) array; points near each of k edges, and the edges'
        directions.
    reach : float [px]; how far to look on either side.
    Returns points, spread : (k, n, 2), (k, n) array [px]; centroids of the gradient along the
        normals, and its standard deviation: the edge's blur.
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


@dataclass(frozen=True, eq=False)
class _Edge:
    """A line or parabola: `origin + s u + (a + b s + c s^2) v`."""

    origin: Array  # (2,) [px]
    u: Array  # unit vectors along the edge and across it (2,)
    v: Array
    terms: Array  # a, b and c (3,)
    rough: float  # rms distance of its points [px]

    def at(self, s: float) -> tuple[Array, Array]:
        """Return the point at `s` and the tangent there."""
        a, b, c = self.terms
        place = self.origin + s * self.u + (a + b * s + c * s**2) * self.v
        return place, self.u + (b + 2.0 * c * s) * self.v


def _fitted(points: Array, origin: Array, along: Array, degree: int, asked: int) -> _Edge | None:
    """Fit an edge to points (n, 2) near it, far ones left out; None if few of those `asked` fit."""
    u = along / max(float(np.linalg.norm(along)), 1e-9)
    v = np.array([-u[1], u[0]])
    s, y = (points - origin) @ u, (points - origin) @ v
    powers = np.vander(s, degree + 1, increasing=True)
    keep = np.ones(len(s), bool)
    for _ in range(3):
        if keep.sum() < 0.5 * asked:
            return None
        fit = np.linalg.lstsq(powers[keep], y[keep], rcond=None)[0]
        miss = np.abs(y - powers @ fit)
        keep = miss < max(_STRAY * float(np.median(miss[keep])), 0.05)
    rough = float(np.sqrt(np.mean(miss[keep] ** 2)))
    return _Edge(origin, u, v, np.pad(fit, (0, 2 - degree)), rough)


def _cross(one: _Edge, other: _Edge) -> Array:
    """Return where two edges cross (2,), by Newton's method from their origins."""
    s = np.zeros(2)
    for _ in range(4):
        (p, dp), (q, dq) = one.at(s[0]), other.at(s[1])
        s = s - np.linalg.lstsq(np.stack([dp, -dq], axis=1), p - q, rcond=None)[0]
    return one.at(s[0])[0]


def refine_corners(
    grey: Picture, corners: Mapping[int, Array], squares: tuple[int, int], share: float
) -> dict[int, Array]:
    """Put corners of a board, known within two pixels, where its edges cross.

    Corners are places (2,) [px] by number, as in the answer: a hidden one has no edges, and is left
    out.

    squares, share : columns and rows of the board; side of its tags, as a share of a square's
    """
    if len(corners) < 4:
        return {}
    places = {n: np.asarray(place, float) for n, place in corners.items()}
    refined: dict[int, Array] = {}
    for _ in range(2):
        refined = _crossings(grey, places, squares, share)
        places |= refined
    near = _near(refined, corners)
    # small squares, or tags that fill them, have no edges to speak of
    return near if len(near) >= 0.6 * len(corners) else _by_window(grey, corners)


def _near(refined: Mapping[int, Array], corners: Mapping[int, Array]) -> dict[int, Array]:
    """Return what did not go far: a corner that did was none."""
    return {n: p for n, p in refined.items() if np.linalg.norm(p - corners[n]) < 2.5}


def _crossings(
    grey: Picture, places: Mapping[int, Array], squares: tuple[int, int], share: float
) -> dict[int, Array]:
    """Return where the edges of squares cross; none where squares are too small for edges."""
    columns, rows = squares
    width = columns - 1
    grid = np.full((rows + 1, columns + 1, 2), np.nan)
    for n, place in places.items():
        grid[1 + n // width, 1 + n % width] = place
    here = grid[1:-1, 1:-1]
    shifts = ((0, -1), (0, 1), (-1, 0), (1, 0))  # the next corner to the right, left, below, above
    ahead = np.stack([np.roll(grid, shift, (1, 0))[1:-1, 1:-1] - here for shift in shifts], axis=2)
    # the outer corners' edges run a square beyond them, as far as on the other side
    ahead = np.where(np.isnan(ahead), -ahead[:, :, [1, 0, 3, 2]], ahead)
    known = np.isfinite(ahead).all(axis=(2, 3)) & np.isfinite(here).all(axis=2)
    numbers, c, d = np.flatnonzero(known), here[known], ahead[known]  # d (corners, 4, 2)
    if not len(numbers):
        return {}
    part, low = _blurred_part(grey, (c[:, None] + d).reshape(-1, 2))
    c = c - low
    area = np.abs(d[:, 0, 0] * d[:, 2, 1] - d[:, 0, 1] * d[:, 2, 0])
    gap = 0.5 * (1.0 - share) * area / np.linalg.norm(d, axis=2).max(1)
    reach = min(float(np.median(gap)) - _CLEAR, 4.0)
    if reach < _LEAST_REACH:
        return {}
    base = c[:, None, None] + _ALONG * d[:, :, None]
    flat = base.reshape(-1, len(_ALONG), 2)
    points, spread = _edge_points(part, flat, d.reshape(-1, 2), reach)
    points = points.reshape(base.shape)
    inside = ((base > 0.0) & (base < np.subtract(part.shape[::-1], 1))).all(-1)
    there = inside & (spread.reshape(base.shape[:3]) > 0.05)  # a flat grey has no edge
    refined = {}
    for k, n in enumerate(numbers.tolist()):
        level, upright = (
            _straight(points[k, side], there[k, side], c[k], d[k, side])
            for side in (slice(0, 2), slice(2, 4))
        )
        if level is not None and upright is not None:
            refined[n] = _cross(level, upright) + low
    return refined


def _straight(points: Array, there: Mask, corner: Array, ahead: Array) -> _Edge | None:
    """Fit an edge of a board to its points (2, n, 2) on both sides of a corner, if it makes one."""
    if there.mean() < 0.6:
        return None
    edge = _fitted(points[there], corner, ahead[0] - ahead[1], 2, there.size)
    far = float(_ALONG.max() * np.linalg.norm(ahead, axis=1).max())
    if edge is None or edge.rough > _STRAIGHT[0] or abs(edge.terms[2]) * far**2 > _STRAIGHT[1]:
        return None
    return edge


def _by_window(grey: Picture, places: Mapping[int, Array]) -> dict[int, Array]:
    """Refine corners within small windows, as OpenCV does."""
    cv2 = opencv()
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    start = np.array(list(places.values()), np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(grey, start.copy(), (3, 3), (-1, -1), stop)
    moved = np.asarray(refined, float).reshape(-1, 2)
    return _near(dict(zip(places, moved, strict=True)), places)
