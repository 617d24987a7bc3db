"""Boards: patterns with corners at known places, and their corners in a picture."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array, Mask
from ..common.scale import METRES
from ..errors import OptionError
from .pictures import Picture, opencv
from .tags import (
    Tag,
    TagFinder,
    find_dictionary,
    refine_corners,
    single_tags,
    tag_cells,
)

if TYPE_CHECKING:
    from cv2.aruco import CharucoBoard, CharucoDetector

LEAST_CORNERS = 8
"""Corners of a board that a picture must show."""

LEAST_PICTURES = 4
"""Pictures of a board that a calibration needs."""

EXAMPLES = (
    "a chessboard's squares COLSxROWS:SQUARE such as 10x7:22mm, COLSxROWS:SQUARE:MARKER:DICT such "
    "as 7x5:24mm:18mm:5x5_100, or grid:COLSxROWS:TAG:GAP:FAMILY such as grid:6x6:88mm:26.4mm:t36h11"
)


@dataclass(frozen=True, eq=False)
class BlackSquare:
    """A black square of the print; if it is a tag, with white cells."""

    x: float  # left edge, from the print's corner [m]
    y: float  # upper edge [m]
    side: float  # [m]
    white: Mask  # (n, n), the cells by rows


@dataclass(frozen=True)
class Pattern(ABC):
    """A printed board; its frame is OpenCV's: x along a row of corners, y to the next row."""

    columns: int
    rows: int
    side: float  # of a square, or of a tag [m]

    @property
    def text(self) -> str:
        """As `parse_board` reads it."""
        return f"{self.columns}x{self.rows}:{_mm(self.side)}"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print [m]."""
        return self.columns * self.side, self.rows * self.side

    @abstractmethod
    def points(self) -> Array:
        """Corners (n, 3) by their number, in OpenCV's frame [m]."""

    @abstractmethod
    def find(self, grey: Picture) -> dict[int, Array]:
        """Return the corners that a picture shows: number to place (2,) [px]."""

    def black_squares(self) -> Iterator[BlackSquare]:
        """All black squares of the print with its tags; here every other square, from the first."""
        side = self.side
        no_cells = np.zeros((1, 1), bool)
        for x, y in np.ndindex(self.columns, self.rows):
            if (x + y) % 2 == 0:
                yield BlackSquare(x * side, y * side, side, no_cells)

    @property
    def half_turn(self) -> Array | None:
        """The board as it is numbered from its other end (4, 4) [m]; None where tags show it."""
        return None

    def corners(self) -> Array:
        """Corners (n, 3) by their number with y up and the lower left of the print as origin."""
        corners = self.points()
        corners[:, 1] = self.size[1] - corners[:, 1]
        return corners


@dataclass(frozen=True)
class Chessboard(Pattern):
    """A plain chessboard; the origin is its first inner corner."""

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 4:
            raise OptionError(
                f"board {self.text}: expected 4x4 squares or more, such as 10x7:22mm"
            )

    @property
    def half_turn(self) -> Array:
        """The board as it is numbered from its other end (4, 4) [m]."""
        turn = np.diag([-1.0, -1.0, 1.0, 1.0])
        turn[:2, 3] = self.points()[-1, :2]
        return turn

    def points(self) -> Array:
        """Inner corners (n, 3) row by row [m]."""
        y, x = np.indices((self.rows - 1, self.columns - 1)).reshape(2, -1)
        return self.side * np.column_stack([x, y, 0 * x])

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return all inner corners, or none."""
        cv2 = opencv()
        inner = (self.columns - 1, self.rows - 1)
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
        is_there, corners = cv2.findChessboardCorners(
            grey, inner, flags=flags + cv2.CALIB_CB_FAST_CHECK
        )
        if is_there:
            corners = self._refine(grey, np.reshape(corners, (-1, 2)))
        else:  # slower, and finds boards in dark pictures
            is_there, corners = cv2.findChessboardCornersSB(
                grey, inner, flags=0
            )
        if not is_there:
            return {}
        return dict(enumerate(np.asarray(corners, float).reshape(-1, 2)))

    def _refine(self, grey: Picture, corners: Array) -> Array:
        """Corners (n, 2) [px] to less than a pixel, each in a window of half a square."""
        cv2 = opencv()
        grid = corners.reshape(self.rows - 1, self.columns - 1, 2)
        down = np.linalg.norm(np.diff(grid, axis=0), axis=2)
        across = np.linalg.norm(np.diff(grid, axis=1), axis=2)
        # half the window is a quarter of a square, so that no other corner is near
        square = min(down.min(), across.min())
        half = int(np.clip(0.25 * square, 3, 15))
        start = corners.reshape(-1, 1, 2).astype(np.float32)
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        refined: Array = cv2.cornerSubPix(
            grey, start, (half, half), (-1, -1), stop
        )
        return refined


@dataclass(frozen=True)
class CharucoPattern(Pattern):
    """A chessboard with tags in its white squares; the origin is a corner of the print."""

    marker: float  # side of a tag within a square [m]
    dictionary: str = "5x5_100"  # the tags'

    def __post_init__(self) -> None:
        most = len(find_dictionary(self.dictionary).bytesList)
        is_large = (self.columns - 1) * (self.rows - 1) >= LEAST_CORNERS
        is_whole = is_large and self.tags <= most
        if not (is_whole and 0.0 < self.marker < self.side):
            raise OptionError(
                f"board {self.text}: expected {LEAST_CORNERS} inner corners or more, tags smaller "
                f"than squares, and at most the {most} tags of {self.dictionary} (here "
                f"{self.tags}); such as 7x5:24mm:18mm:5x5_100"
            )

    @property
    def text(self) -> str:
        """As `parse_board` reads it."""
        return f"{super().text}:{_mm(self.marker)}:{self.dictionary}"

    @property
    def tags(self) -> int:
        """Number of tags; their ids count from 0."""
        return self.columns * self.rows // 2

    @cached_property
    def charuco(self) -> CharucoBoard:
        """The board of OpenCV, whose y runs down."""
        board: CharucoBoard = opencv().aruco.CharucoBoard(
            (self.columns, self.rows),
            self.side,
            self.marker,
            find_dictionary(self.dictionary),
        )
        return board

    @cached_property
    def _detector(self) -> CharucoDetector:
        detector: CharucoDetector = opencv().aruco.CharucoDetector(self.charuco)
        return detector

    def points(self) -> Array:
        """Inner corners (n, 3) by their number [m]."""
        return np.array(self.charuco.getChessboardCorners(), float)

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return the corners that a picture shows: number to place (2,) [px]."""
        corners, numbers = self._detector.detectBoard(grey)[:2]
        if numbers is None:
            return {}
        places = np.asarray(corners, float).reshape(-1, 2)
        by_number = sorted(zip(np.ravel(numbers).tolist(), places, strict=True))
        return refine_corners(grey, dict(by_number), self.charuco)

    def black_squares(self) -> Iterator[BlackSquare]:
        """Black squares, and tags where OpenCV's detector expects them."""
        yield from super().black_squares()
        places = np.array(self.charuco.getObjPoints())[:, :, :2].min(axis=1)
        for number, (x, y) in enumerate(places):
            yield BlackSquare(
                x, y, self.marker, tag_cells(number, self.dictionary)
            )


@dataclass(frozen=True)
class TagGrid(Pattern):
    """A grid of AprilTags, as OpenCV prints it (rows run down) or Kalibr (rows run up)."""

    gap: float  # between two tags [m]
    family: str = "t36h11"

    def __post_init__(self) -> None:
        most = len(find_dictionary(self.dictionary).bytesList)
        if not 2 <= self.columns * self.rows <= most:
            raise OptionError(
                f"board {self.text}: expected 2 to {most} tags of {self.family}"
            )

    @property
    def dictionary(self) -> str:
        """OpenCV's name of the family."""
        return self.family.removeprefix("t")

    @property
    def text(self) -> str:
        """As `parse_board` reads it."""
        return f"grid:{super().text}:{_mm(self.gap)}:{self.family}"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print [m]."""
        pitch = self.side + self.gap
        return self.columns * pitch - self.gap, self.rows * pitch - self.gap

    def points(self) -> Array:
        """Corners of the tags (4 n, 3), clockwise from the top left of each [m]."""
        row, column = np.indices((self.rows, self.columns)).reshape(2, -1)
        first = (self.side + self.gap) * np.column_stack([column, row])
        square = self.side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        flat = (first[:, None] + square).reshape(-1, 2)
        return np.pad(flat, ((0, 0), (0, 1)))

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return the corners of the tags that a picture shows, four of each."""
        finder = TagFinder(self.dictionary, range(self.columns * self.rows))
        tags = single_tags(finder.find(grey))
        is_upward = _is_upward(tags, self.columns)
        corners: dict[int, Array] = {}
        for tag in tags:
            row, column = divmod(tag.number, self.columns)
            if is_upward:
                row = self.rows - 1 - row
            first = 4 * (row * self.columns + column)
            corners |= dict(enumerate(tag.corners, first))
        return dict(sorted(corners.items()))

    def black_squares(self) -> Iterator[BlackSquare]:
        """Tags."""
        for number, (x, y, _) in enumerate(self.points()[::4]):
            yield BlackSquare(
                x, y, self.side, tag_cells(number, self.dictionary)
            )


def _is_upward(tags: list[Tag], columns: int) -> bool:
    """Whether rows of tags run up the page, as the tags' own corners show."""
    rows = np.array([tag.number // columns for tag in tags])
    corners = np.array([tag.corners for tag in tags]).reshape(-1, 4, 2)
    down = (corners[:, 3] - corners[:, 0]).sum(axis=0)
    heights = corners[:, 0] @ down
    steps = rows[:, None] - rows
    rises = heights[:, None] - heights
    return bool((steps * rises).sum() < 0.0)


def parse_board(board: Pattern | str) -> Pattern:
    """Read a board.

    `10x7:22mm` is a plain chessboard: squares across and down, and their side;
    `7x5:24mm:18mm:5x5_100` a ChArUco board: squares, their side, the tags' side, the dictionary;
    `grid:6x6:88mm:26.4mm:t36h11` a grid of AprilTags: tags, their side, the gap, the family.
    """
    if isinstance(board, Pattern):
        return board
    match = re.fullmatch(
        r"(grid:)?\s*(\d{1,3})\s*[xX]\s*(\d{1,3})\s*:([^:]+)(?::([^:]+))?(?::(.+))?",
        board,
    )
    if match is None or (match[1] and not match[5]):
        raise OptionError(f"board {board!r}: expected {EXAMPLES}")
    grid, columns, rows, first, second, family = match.groups()
    size = (int(columns), int(rows))
    side = parse_length(first, "board's length")
    if not second:
        return Chessboard(*size, side)
    other = parse_length(second, "board's length")
    families = [family] if family else []
    if grid:
        return TagGrid(*size, side, other, *families)
    return CharucoPattern(*size, side, other, *families)


def parse_length(text: str, what: str, *, signed: bool = False) -> float:
    """Read a length [m] such as "24mm", above zero, or where `signed` of either sign.

    what : name of the length in messages
    Raises OptionError if the text has no number, or no unit.
    """
    match = re.fullmatch(r"\s*(-?\d*\.?\d+)\s*(mm|cm|m|in)\s*", text)
    value = float(match[1]) / METRES[match[2]] if match else np.nan
    if not (-10.0 if signed else 0.0) < value < 10.0:
        raise OptionError(
            f"{what} {text!r}: expected a number and its unit, such as 24mm"
        )
    return value


def _mm(length: float) -> str:
    return f"{1e3 * length:.12g}mm"
