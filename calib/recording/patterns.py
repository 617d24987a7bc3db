"""Printed patterns laid over a picture, to about a hundredth of a pixel.

What is printed is known to its last cell: the picture of it is moved by a homography until it
correlates best with what the camera saw, by OpenCV's `findTransformECC` (Evangelidis and Psarakis,
2008). A blur of the camera shifts nothing. The middle of a tag is where its diagonals cross, which
perspective keeps, and not the mean of its corners.

On the pictures of benchmarks/camera.py tags are found to .010 px, .012 where blurred; OpenCV's
contours alone leave .093 and .113, lines fitted to the four sides .030 and .054.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .opencv import Picture, opencv

_BLUR = 3  # [px], Gaussian window over both pictures
_STEPS, _SETTLED = 30, 1e-5
_LEAST_CELL = 3  # [px]; a coarser pattern has no edges
_SQUARES = (8, 96)  # [px], least and largest side of a board's square in its picture
_DENSE = 1.5  # of a board's pattern over the picture: .011 px for .016 with 1, .012 with 3
_FINER = (2, 6)  # times as fine a board is drawn, and then shrunk
_AROUND = 0.7  # squares around a corner that are laid over the picture
_FARTHEST = 2.5  # [px]; a corner that goes further was none


def lay_square(grey: Picture, cells: NDArray[np.bool_], corners: Array) -> tuple[Array, float]:
    """Lay a tag over its picture.

    cells : (n, n), which cells are white, the black border included
    corners : (4, 2) [px], within a pixel or so, clockwise in print from the top left
    Returns corners : (4, 2) [px], refined; and the correlation of print and picture, 0 for none.
    """
    cv2, n = opencv(), len(cells)
    side = float(np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).mean())
    k = max(_LEAST_CELL, round(side / n))
    pattern = np.pad(np.kron(cells, np.ones((k, k))), k // 2 + 1, constant_values=1.0)
    low, high = k // 2 + 0.5, k // 2 + 0.5 + n * k  # of the square: pixels have whole centres
    square = np.array([[low, low], [high, low], [high, high], [low, high]])
    start = cv2.getPerspectiveTransform(square.astype(np.float32), corners.astype(np.float32))
    found, likeness = _laid(grey, (255.0 * pattern).astype(np.uint8), np.asarray(start))
    return _mapped(found, square), likeness


def lay_corners(grey: Picture, corners: Mapping[int, Array], board: Any) -> dict[int, Array]:
    """Lay the surroundings of a board's corners over its picture.

    corners : places (2,) [px] by number, within a pixel or so; `board` is OpenCV's
    """
    if len(corners) < 4:
        return {}
    cv2 = opencv()
    numbers, seen = list(corners), np.array([*corners.values()])
    flat = np.asarray(board.getChessboardCorners())[numbers, :2] / board.getSquareLength()
    over = cv2.findHomography(flat, seen, cv2.RANSAC, 3.0)[0]
    if over is None:
        return {}
    ahead = _mapped(over, flat + 0.5) - _mapped(over, flat - 0.5)
    k = int(
        np.clip(round(_DENSE * np.median(np.linalg.norm(ahead, axis=1)) / np.sqrt(2)), *_SQUARES)
    )
    page, refined = _page(board, k), {}
    for number, place, there in zip(numbers, flat, seen, strict=True):
        at = np.maximum(np.round((place - _AROUND) * k).astype(int), 0)
        end = np.round((place + _AROUND) * k).astype(int)
        # of the patch's pixels, via squares, to the picture; the lens shifts it by little
        scale = np.array([[1 / k, 0, (at[0] + 0.5) / k], [0, 1 / k, (at[1] + 0.5) / k], [0, 0, 1]])
        shift = np.eye(3)
        shift[:2, 2] = there - _mapped(over, place[None])[0]
        own = (place * k - 0.5 - at)[None]
        found, likeness = _laid(grey, page[at[1] : end[1], at[0] : end[0]], shift @ over @ scale)
        moved = _mapped(found, own)[0]
        if likeness > 0.0 and np.linalg.norm(moved - there) < _FARTHEST:
            refined[number] = moved
    return refined


def crossing(corners: Array) -> Array:
    """Return where the diagonals of a square cross: its middle under any perspective [px]."""
    a, b, c, d = np.c_[corners - corners[0], np.ones(4)]
    p = np.cross(np.cross(a, c), np.cross(b, d))
    return np.asarray(corners[0] + p[:2] / p[2])


def _laid(grey: Picture, pattern: Picture, start: Array) -> tuple[Array, float]:
    """Move a pattern over a picture from a homography (3, 3) of its pixels to the best one.

    Returns that, and the correlation; the start and 0 where none is found.
    """
    cv2 = opencv()
    high, wide = pattern.shape
    outline = _mapped(start, np.array([[0, 0], [wide, 0], [wide, high], [0, high]]) - 0.5)
    if not np.isfinite(outline).all() or np.abs(outline).max() > 1e5:
        return start, 0.0
    low = np.maximum(np.floor(outline.min(0)).astype(int) - 8, 0)
    end = np.maximum(np.ceil(outline.max(0)).astype(int) + 9, low + 1)
    part = grey[low[1] : end[1], low[0] : end[0]]
    back = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]], [0.0, 0.0, 1.0]])
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, _STEPS, _SETTLED)
    guess = back @ start
    guess = np.ascontiguousarray(guess / guess[2, 2], np.float32)
    try:
        likeness, found = cv2.findTransformECC(
            pattern, part, guess, cv2.MOTION_HOMOGRAPHY, stop, None, _BLUR
        )
    except cv2.error:  # it did not converge, or the part is empty
        return start, 0.0
    return np.linalg.inv(back) @ np.asarray(found, float), float(likeness)


@cache
def _page(board: Any, k: int) -> Picture:
    """The picture of a board whose squares have sides of k pixels."""
    columns, rows = board.getChessboardSize()
    share = board.getMarkerLength() / board.getSquareLength()
    cells = board.getDictionary().markerSize + 2
    # drawn finer and shrunk, at a size at which tags and their cells begin on whole pixels
    sizes = np.arange(_FINER[0] * k, _FINER[1] * k)
    ends = np.stack([0.5 * (1.0 - share) * sizes, share / cells * sizes])
    fine = int(sizes[np.argmin(np.abs(ends - np.round(ends)).sum(axis=0).round(6))])
    drawn = board.generateImage((columns * fine, rows * fine), marginSize=0, borderBits=1)
    size = (columns * k, rows * k)
    return np.asarray(opencv().resize(drawn, size, interpolation=opencv().INTER_AREA))


def _mapped(homography: Array, places: Array) -> Array:
    """Map places (n, 2) by a homography (3, 3)."""
    p = np.c_[places, np.ones(len(places))] @ homography.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(p[:, :2] / p[:, 2:])
