"""Tags: printed tags in a picture, to a few hundredths of a pixel.

`findTransformECC` (Evangelidis and Psarakis, 2008) aligns the print with the picture: tags to .010
px, where OpenCV's contours leave .093; a board's corners to .011 for .06 (benchmarks/camera.py).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.rows import median_length, row_lengths
from ..common.wording import suggestion
from ..errors import OptionError
from .pictures import Picture, opencv

if TYPE_CHECKING:
    from cv2.aruco import CharucoBoard, Dictionary

LEAST_NOISE = 0.03
"""Least standard deviation of a tag's centre along each axis [px]."""


@dataclass(frozen=True)
class TagSettings:
    """How tags and corners are read."""

    # correlation with the print, below which a tag is not sharp
    sharp: float = 0.8
    # share of a cell that is not read, and pixels along a cell: of 60 tags of some 20 px 40 are
    # found, 25 with OpenCV's 4 pixels, 32 with these and a margin of .3
    margin: float = 0.2
    read: int = 10
    # [px], Gaussian window over print and picture
    blur: int = 3
    steps: int = 30
    settled: float = 1e-5
    # [px]; a coarser pattern has no edges
    least_cell: int = 3
    # [px], least and largest side of a board's square in its picture
    squares: tuple[int, int] = (8, 96)
    # resolution of a board's pattern over that of the picture: .011 px for .016 with 1, .012 with 3
    dense: float = 1.5
    # resolutions at which a board may be drawn before it is shrunk, over the final one
    finer: tuple[int, int] = (2, 6)
    # squares to each side of a corner that are aligned with the picture
    around: float = 0.7
    # largest step of a true corner [px]
    farthest: float = 2.5


TAG = TagSettings()


@dataclass(frozen=True, eq=False)
class Tag:
    """A tag in a picture; pixel centres have whole coordinates, y runs down."""

    number: int  # its id
    # of the black square, clockwise in print from the top left (4, 2) [px]
    corners: Array
    # standard deviation of the centre along each axis [px]
    noise: float = LEAST_NOISE
    sharp: bool = True  # whether the print could be aligned with it

    @property
    def centre(self) -> Array:
        """Where the diagonals cross (2,) [px]: the middle under any perspective."""
        a, b, c, d = np.c_[self.corners - self.corners[0], np.ones(4)]
        x, y, scale = np.cross(np.cross(a, c), np.cross(b, d))
        return np.asarray(self.corners[0] + np.array([x, y]) / scale)

    @property
    def side(self) -> float:
        """Mean length of its sides [px]."""
        sides = np.roll(self.corners, -1, axis=0) - self.corners
        return float(row_lengths(sides).mean())


@cache
def find_dictionary(name: str) -> Dictionary:
    """Return OpenCV's dictionary of a name; case, `DICT_` and `apriltag_` may be left out.

    Raises OptionError if there is none.
    """
    aruco = opencv().aruco
    keys = {
        key[5:].lower(): key for key in dir(aruco) if key.startswith("DICT_")
    }
    plain = name.lower().removeprefix("dict_")
    key = keys.get(plain) or keys.get(f"apriltag_{plain}")
    if key is None:
        raise OptionError(
            f"dictionary {name!r}: {suggestion(plain, sorted(keys))}"
        )
    patterns: Dictionary = aruco.getPredefinedDictionary(getattr(aruco, key))
    return patterns


class TagFinder:
    """Finds tags of one dictionary: wanted ids, or all, which takes ten times as long."""

    def __init__(
        self,
        dictionary: str,
        wanted: Collection[int] | None = None,
    ) -> None:
        aruco = opencv().aruco
        patterns = find_dictionary(dictionary)
        count = len(patterns.bytesList)
        if wanted is None:
            wanted = range(count)
        self.numbers = sorted(set(wanted))
        for number in {*self.numbers[:1], *self.numbers[-1:]}:
            tag_cells(number, dictionary)  # refuses what is none
        patterns = aruco.Dictionary(
            np.ascontiguousarray(patterns.bytesList[self.numbers]),
            patterns.markerSize,
            patterns.maxCorrectionBits,
        )
        self.dictionary = dictionary
        settings = aruco.DetectorParameters()
        settings.cornerRefinementMethod = aruco.CORNER_REFINE_CONTOUR
        settings.perspectiveRemoveIgnoredMarginPerCell = TAG.margin
        settings.perspectiveRemovePixelPerCell = TAG.read
        self._detector = aruco.ArucoDetector(patterns, settings)

    def find(self, grey: Picture) -> list[Tag]:
        """Find the tags of a picture."""
        squares, ids, _ = self._detector.detectMarkers(grey)
        tags = []
        for k, square in enumerate(squares):
            number = self.numbers[int(ids[k].item())]
            corners = np.asarray(square, float).reshape(4, 2)
            tags.append(self._refine_tag(grey, number, corners))
        return tags

    def _refine_tag(self, grey: Picture, number: int, corners: Array) -> Tag:
        """The tag at corners (4, 2) [px], refined by aligning its print with the picture."""
        cells = tag_cells(number, self.dictionary)
        tag = Tag(number, corners, 0.5, sharp=False)
        count = len(cells)
        k = max(TAG.least_cell, round(tag.side / count))
        tag_pixels = np.kron(cells, np.ones((k, k)))
        pattern = np.pad(tag_pixels, k // 2 + 1, constant_values=1.0)
        # pixels have whole centres
        low = k // 2 + 0.5
        high = low + count * k
        square = np.array([[low, low], [high, low], [high, high], [low, high]])
        start = opencv().getPerspectiveTransform(
            square.astype(np.float32), corners.astype(np.float32)
        )
        page = (255.0 * pattern).astype(np.uint8)
        homography, likeness = _align(grey, page, np.asarray(start))
        if likeness < TAG.sharp:
            return tag
        return Tag(number, _map_places(homography, square))


def single_tags(tags: Sequence[Tag]) -> list[Tag]:
    """The tags whose ids are there once: of two alike either may be another board's."""
    counts = Counter(tag.number for tag in tags)
    return [tag for tag in tags if counts[tag.number] == 1]


def tag_cells(number: int, dictionary: str) -> NDArray[np.bool_]:
    """Return which cells of a tag are white, its black border included: (cells, cells).

    Raises OptionError if the dictionary has no such id.
    """
    patterns = find_dictionary(dictionary)
    count = len(patterns.bytesList)
    if not 0 <= number < count:
        raise OptionError(
            f"tag {number}: expected 0 to {count - 1}, the ids of {dictionary}"
        )
    size = int(patterns.markerSize) + 2
    picture = opencv().aruco.generateImageMarker(patterns, int(number), size)
    return np.asarray(picture) > 127


def refine_corners(
    grey: Picture, corners: Mapping[int, Array], board: CharucoBoard
) -> dict[int, Array]:
    """Refine corners to .01 px by aligning the print around each with the picture.

    corners : places (2,) [px] by number, to about a pixel;  board : of OpenCV
    Returns places (2,) [px] by number of the refined ones.
    """
    if len(corners) < 4:
        return {}
    cv2 = opencv()
    pixels = np.array([*corners.values()])
    points = np.array(board.getChessboardCorners(), float)
    squares = points[list(corners), :2] / board.getSquareLength()
    # from squares of the board to pixels, but for the lens
    board_to_picture, _ = cv2.findHomography(squares, pixels, cv2.RANSAC, 3.0)
    if board_to_picture is None:
        return {}
    without_lens = _map_places(board_to_picture, squares)
    k = _print_density(board_to_picture, squares)
    page = _page(board, k)

    refined = {}
    shifts = pixels - without_lens
    for row, number in enumerate(corners):
        square = squares[row]
        low = np.round((square - TAG.around) * k).astype(int)
        low = np.maximum(low, 0)
        high = np.round((square + TAG.around) * k).astype(int)
        patch = page[low[1] : high[1], low[0] : high[0]]
        # from the patch's pixels to squares, to pixels, to where the lens has this corner
        to_squares = np.diag([1 / k, 1 / k, 1.0])
        to_squares[:2, 2] = (low + 0.5) / k
        by_lens = np.eye(3)
        by_lens[:2, 2] = shifts[row]
        start = by_lens @ board_to_picture @ to_squares
        homography, likeness = _align(grey, patch, start)
        in_patch = square * k - 0.5 - low
        refined_place = _map_places(homography, in_patch[None])[0]
        distance = np.linalg.norm(refined_place - pixels[row])
        if likeness > 0.0 and distance < TAG.farthest:
            refined[number] = refined_place
    return refined


def _print_density(board_to_picture: Array, squares: Array) -> int:
    """Pixels of a square of the print, about as fine as the picture at places (n, 2) [squares]."""
    lower_right = _map_places(board_to_picture, squares + 0.5)
    diagonals = lower_right - _map_places(board_to_picture, squares - 0.5)
    diagonal = median_length(diagonals)
    pixels_of_square = round(TAG.dense * diagonal / np.sqrt(2))
    return int(np.clip(pixels_of_square, *TAG.squares))


def _align(
    grey: Picture, pattern: Picture, start: Array
) -> tuple[Array, float]:
    """The homography (3, 3) that best aligns a pattern with a picture; their correlation, or 0."""
    cv2 = opencv()
    height, width = pattern.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    outline = _map_places(start, corners)
    if not np.abs(outline).max() < 1e5:
        return start, 0.0
    low = np.maximum(np.floor(outline.min(0)).astype(int) - 8, 0)
    high = np.maximum(np.ceil(outline.max(0)).astype(int) + 9, low + 1)
    to_window = np.eye(3)
    to_window[:2, 2] = -low
    stop = (
        cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT,
        TAG.steps,
        TAG.settled,
    )
    window = grey[low[1] : high[1], low[0] : high[0]]
    guess = to_window @ start
    guess /= guess[2, 2]
    try:
        likeness, homography = cv2.findTransformECC(
            pattern,
            window,
            guess.astype(np.float32),
            cv2.MOTION_HOMOGRAPHY,
            stop,
            None,
            TAG.blur,
        )
    except cv2.error:  # it did not converge, or the window is empty
        return start, 0.0
    whole = np.linalg.inv(to_window) @ np.asarray(homography, float)
    return whole, float(likeness)


@cache
def _page(board: CharucoBoard, k: int) -> Picture:
    """The picture of a board whose squares have sides of k pixels."""
    columns, rows = board.getChessboardSize()
    share = board.getMarkerLength() / board.getSquareLength()
    cells = board.getDictionary().markerSize + 2
    # drawn finer and shrunk, at a size at which tags and their cells begin on whole pixels
    sizes = np.arange(TAG.finer[0] * k, TAG.finer[1] * k)
    margins = 0.5 * (1.0 - share) * sizes
    cell_sides = share / cells * sizes
    ends = np.stack([margins, cell_sides])
    rests = np.abs(ends - np.round(ends)).sum(axis=0)
    fine = int(sizes[np.argmin(rests.round(6))])
    fine_size = (columns * fine, rows * fine)
    drawn = board.generateImage(fine_size, marginSize=0, borderBits=1)
    size = (columns * k, rows * k)
    cv2 = opencv()
    return np.asarray(cv2.resize(drawn, size, interpolation=cv2.INTER_AREA))


def _map_places(homography: Array, places: Array) -> Array:
    """Map places (n, 2) by a homography (3, 3)."""
    return np.asarray(
        opencv().perspectiveTransform(places[None], homography)[0]
    )
