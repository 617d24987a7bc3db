"""Edges of printed squares to a few hundredths of a pixel, and the corners where they cross.

Points of an edge are the centroids of the grey level's gradient along its normal. A tag's side
is a line; the middle is where the diagonals cross: perspective keeps both, and not the mean of the
corners. At a board's corner parabolas are fitted to the edges that run a whole square from it: tags
within the squares come near it, so a window about it says little.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .opencv import Picture, opencv

if TYPE_CHECKING:
    from .board import Board


_POINTS = 31  # along each side
_STEP = 0.25  # between samples of the grey level along a normal [px]
_ENDS = 0.09  # share of a side that is left out at each end: corners are round
_BLUR = 0.6  # [px]
_LEAST_REACH = 1.3  # [px]; of a profile that still holds an edge
_CLEAR = 1.3  # [px]; the blur of the tags beside an edge
_ALONG = np.linspace(0.14, 0.82, 14)[:, None]  # of a square: near a corner edges are round


def refine_square(grey: Picture, corners: Array, cells: int = 8) -> tuple[Array, float]:
    """Fit lines to the four sides of a dark square on white, and cross them.

    corners : (4, 2) array [px]; corners within a pixel or so, in their order around the square.
    cells : int; cells along a side, border included: a profile stays within half of one.
    Returns corners : (4, 2) array [px]; the refined corners, in the same order.
    Returns roughness : float [px]; rms distance of the worst side's points from its line.
    """
    part, low = blurred_part(grey, corners)
    c = corners - low
    side = float(np.linalg.norm(np.roll(c, -1, 0) - c, axis=1).min())
    reach = float(np.clip(0.6 * side / cells, 1.5, 4.0))
    along = np.linspace(_ENDS, 1.0 - _ENDS, _POINTS)[:, None]
    roughness = 0.0
    for _ in range(2):
        ahead = np.roll(c, -1, 0) - c
        points, _ = edge_points(part, c[:, None] + along * ahead[:, None], ahead, reach)
        lines, rough = zip(*map(_line, points), strict=True)
        roughness = max(rough)
        crossed = np.cross(np.roll(lines, 1, axis=0), lines)
        with np.errstate(divide="ignore", invalid="ignore"):
            c = crossed[:, :2] / crossed[:, 2:]
        if not np.isfinite(c).all():
            return corners, np.inf
    return c + low, roughness


def blurred_part(grey: Picture, points: Array) -> tuple[NDArray[np.float32], Array]:
    """Return the part of a picture around points, a little blurred, and its corner [px]."""
    low = np.maximum(np.floor(points.min(0)).astype(int) - 12, 0)
    high = np.ceil(points.max(0)).astype(int) + 13
    part = opencv().GaussianBlur(grey[low[1] : high[1], low[0] : high[0]], (0, 0), _BLUR)
    return part.astype(np.float32), low.astype(float)


def edge_points(
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


def refine_corners(grey: Picture, corners: Mapping[int, Array], board: Board) -> dict[int, Array]:
    """Put corners of a board, known within two pixels, where its edges cross.

    Corners are places (2,) [px] by number, as in the answer: a hidden one has no edges, and is left
    out.
    """
    if len(corners) < 4:
        return {}
    places = {n: np.asarray(place, float) for n, place in corners.items()}
    refined: dict[int, Array] | None = None
    for _ in range(2):
        refined = _once(grey, places, board)
        if refined is None:
            break
        places |= refined
    near = {} if refined is None else _near(refined, corners)
    # small squares, or tags that fill them, have no edges to speak of
    return near if len(near) >= 0.6 * len(corners) else _by_window(grey, corners)


def _near(refined: Mapping[int, Array], corners: Mapping[int, Array]) -> dict[int, Array]:
    """Return what did not go far: a corner that did was none."""
    return {n: p for n, p in refined.items() if np.linalg.norm(p - corners[n]) < 2.5}


def _once(grey: Picture, places: Mapping[int, Array], board: Board) -> dict[int, Array] | None:
    width = board.columns - 1
    numbers, ahead = [], []
    for n, place in places.items():
        steps = []
        for right, down in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            steps.append(_neighbour(places, n, right, down, width) - place)
        if np.isfinite(steps).all():
            numbers.append(n)
            ahead.append(steps)
    if not numbers:
        return {}
    c = np.array([places[n] for n in numbers])
    d = np.array(ahead)  # (corners, 4, 2)
    # the outer corners' edges run a square beyond them
    part, low = blurred_part(grey, (c[:, None] + d).reshape(-1, 2))
    c = c - low
    area = np.abs(d[:, 0, 0] * d[:, 2, 1] - d[:, 0, 1] * d[:, 2, 0])
    gap = 0.5 * (1.0 - board.marker / board.square) * area / np.linalg.norm(d, axis=2).max(1)
    reach = min(float(np.median(gap)) - _CLEAR, 4.0)
    if reach < _LEAST_REACH:
        return None
    base = c[:, None, None] + _ALONG * d[:, :, None]
    flat = base.reshape(-1, len(_ALONG), 2)
    points, spread = edge_points(part, flat, d.reshape(-1, 2), reach)
    points = points.reshape(base.shape)
    inside = ((base > 0.0) & (base < np.subtract(part.shape[::-1], 1))).all(-1)
    there = inside & (spread.reshape(base.shape[:3]) > 0.05)  # a flat grey has no edge
    refined = {}
    for k, n in enumerate(numbers):
        level = _curve(points[k, :2], there[k, :2], c[k], d[k, 0] - d[k, 1])
        upright = _curve(points[k, 2:], there[k, 2:], c[k], d[k, 2] - d[k, 3])
        if level is not None and upright is not None:
            refined[n] = _cross(level, upright) + c[k] + low
    return refined


def _neighbour(places: Mapping[int, Array], n: int, right: int, down: int, width: int) -> Array:
    """Return where the next corner is, or would be by its opposite; NaN if neither is there."""
    column = n % width
    step = right + down * width
    if n + step in places and 0 <= column + right < width:
        return places[n + step]
    if n - step in places and 0 <= column - right < width:
        return 2.0 * places[n] - places[n - step]
    return np.full(2, np.nan)


def _curve(
    points: Array, there: NDArray[np.bool_], origin: Array, along: Array
) -> tuple[Array, Array, Array] | None:
    """Fit `v = a + b u + c u^2` to points of an edge; None if they make no edge.

    Returns u, v : (2,) array; unit vectors along the edge and across it.
    Returns (a, b, c) : (3,) array; the parabola, about the origin.
    """
    u = along / np.linalg.norm(along)
    v = np.array([-u[1], u[0]])
    p = points[there] - origin
    if there.sum() < 0.6 * there.size:
        return None
    s, y = p @ u, p @ v
    terms = np.stack([np.ones_like(s), s, s**2], 1)
    keep = np.ones(len(s), bool)
    fit = np.zeros(3)
    for _ in range(3):
        fit = np.linalg.lstsq(terms[keep], y[keep], rcond=None)[0]
        miss = np.abs(y - terms @ fit)
        keep = miss < max(3.7 * float(np.median(miss[keep])), 0.05)
        if keep.sum() < 0.5 * there.size:
            return None
    if float(np.sqrt(np.mean(miss[keep] ** 2))) > 0.35 or abs(fit[2]) * s.max() ** 2 > 2.0:
        return None
    return u, v, fit


def _cross(one: tuple[Array, Array, Array], other: tuple[Array, Array, Array]) -> Array:
    t = np.zeros(2)
    for _ in range(5):
        (p, dp), (q, dq) = (_at(curve, s) for curve, s in zip((one, other), t, strict=True))
        t = t - np.linalg.solve(np.stack([dp, -dq], 1), p - q)
    return _at(one, float(t[0]))[0]


def _at(curve: tuple[Array, Array, Array], s: float) -> tuple[Array, Array]:
    u, v, (a, b, c) = curve
    return s * u + (a + b * s + c * s**2) * v, u + (b + 2.0 * c * s) * v


def _by_window(grey: Picture, places: Mapping[int, Array]) -> dict[int, Array]:
    """Refine corners within small windows, as OpenCV does."""
    cv2 = opencv()
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    start = np.array(list(places.values()), np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(grey, start.copy(), (3, 3), (-1, -1), stop)
    moved = np.asarray(refined, float).reshape(-1, 2)
    return _near(dict(zip(places, moved, strict=True)), places)
