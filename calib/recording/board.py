"""Boards: where their corners are in a picture; boards and tags to print, as SVG."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..common.arrays import Array, Mask
from ..common.choices import DICTIONARY
from ..common.scale import METRES
from ..common.wording import filled
from ..errors import OptionError
from .pictures import Picture, opencv
from .tags import Tag, TagFinder, find_dictionary, lay_corners, tag_cells

LEAST_CORNERS = 8
"""Corners of a board that a picture must show."""

_WINDOW = 0.25  # shares of a square around a corner that its edges are looked for in
_WINDOWS = (3, 15)  # [px]
_MARGIN = 8.0  # [mm] of white around a pattern, beyond its own


class Pattern:
    """A printed board; its frame is OpenCV's: x along a row of corners, y to the next row."""

    columns: int
    rows: int

    @property
    def side(self) -> float:
        """Side of a square, or of a tag [m]."""
        raise NotImplementedError

    @property
    def text(self) -> str:
        """As `parse_board` reads it."""
        raise NotImplementedError

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print [m]."""
        raise NotImplementedError

    def points(self) -> Array:
        """Corners (n, 3) by their number, in OpenCV's frame [m]."""
        raise NotImplementedError

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return the corners that a picture shows: number to place (2,) [px]."""
        raise NotImplementedError

    @property
    def half_turn(self) -> Array | None:
        """The board as it is numbered from its other end (4, 4) [m]; None where tags tell."""
        return None

    def corners(self) -> Array:
        """Corners (n, 3) by their number with y up and the lower left of the print as origin."""
        corners = self.points()
        corners[:, 1] = self.size[1] - corners[:, 1]
        return corners


@dataclass(frozen=True)
class Chessboard(Pattern):
    """A plain chessboard; the origin is its first inner corner."""

    columns: int  # squares
    rows: int
    square: float  # side of a square [m]

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 4:
            raise OptionError(
                f"board {self.text}: expected 4x4 squares or more, such as 10x7:22mm"
            )

    @property
    def side(self) -> float:
        """Side of a square [m]."""
        return self.square

    @property
    def inner(self) -> tuple[int, int]:
        """Columns and rows of inner corners."""
        return self.columns - 1, self.rows - 1

    @property
    def text(self) -> str:
        """As `parse_board` reads it."""
        return f"{self.columns}x{self.rows}:{1e3 * self.square:.12g}mm"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print [m]."""
        return self.columns * self.square, self.rows * self.square

    @property
    def half_turn(self) -> Array:
        """The board as it is numbered from its other end (4, 4) [m]."""
        turn = np.diag([-1.0, -1.0, 1.0, 1.0])
        turn[:2, 3] = self.points()[-1, :2]
        return turn

    def points(self) -> Array:
        """Inner corners (n, 3) row by row [m]."""
        across, down = self.inner
        corners = np.zeros((down, across, 3))
        corners[..., 0] = self.square * np.arange(across)
        corners[..., 1] = self.square * np.arange(down)[:, None]
        return corners.reshape(-1, 3)

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return all inner corners, or none."""
        cv2 = opencv()
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(
            grey, self.inner, flags=flags + cv2.CALIB_CB_FAST_CHECK
        )
        if found:
            rows = np.reshape(corners, (self.rows - 1, self.columns - 1, 2))
            gaps = [
                np.linalg.norm(np.diff(rows, axis=axis), axis=2).min()
                for axis in (0, 1)
            ]
            half = int(np.clip(_WINDOW * min(gaps), *_WINDOWS))
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
            start = np.reshape(corners, (-1, 1, 2)).astype(np.float32)
            corners = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), stop)
        else:  # slower, and sees boards in the dark
            found, corners = cv2.findChessboardCornersSB(grey, self.inner, flags=0)
        if not found:
            return {}
        return dict(enumerate(np.asarray(corners, float).reshape(-1, 2)))


@dataclass(frozen=True)
class TagGrid(Pattern):
    """A grid of AprilTags, as OpenCV prints it (rows run down) or Kalibr (rows run up)."""

    columns: int  # tags
    rows: int
    tag: float  # side of a tag's black square [m]
    gap: float  # between two tags [m]
    family: str = "t36h11"

    def __post_init__(self) -> None:
        known = len(find_dictionary(self.dictionary).bytesList)
        if not (2 <= self.columns * self.rows <= known):
            raise OptionError(
                f"board {self.text}: expected 2 to {known} tags of {self.family}"
            )

    @property
    def side(self) -> float:
        """Side of a tag [m]."""
        return self.tag

    @property
    def dictionary(self) -> str:
        """OpenCV's name of the family."""
        return f"apriltag_{self.family.removeprefix('t')}"

    @property
    def text(self) -> str:
        """As `parse_board` reads it."""
        sizes = f"{1e3 * self.tag:.12g}mm:{1e3 * self.gap:.12g}mm"
        return f"grid:{self.columns}x{self.rows}:{sizes}:{self.family}"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print [m]."""
        pitch = self.tag + self.gap
        return self.columns * pitch - self.gap, self.rows * pitch - self.gap

    def points(self) -> Array:
        """Corners of the tags (4 n, 3), clockwise from the top left of each [m]."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        first = (self.tag + self.gap) * np.column_stack([column.ravel(), row.ravel()])
        square = self.tag * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        flat = (first[:, None] + square).reshape(-1, 2)
        return np.column_stack([flat, np.zeros(len(flat))])

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return the corners of the tags that a picture shows, four of each."""
        tags = TagFinder(self.dictionary, range(self.columns * self.rows)).find(grey)
        numbers = [tag.number for tag in tags]
        corners: dict[int, Array] = {}
        for tag in tags:
            if numbers.count(tag.number) > 1:
                continue
            number = tag.number
            if self._upward(tags):
                column = tag.number % self.columns
                number = (
                    self.rows - 1 - tag.number // self.columns
                ) * self.columns + column
            for k, place in enumerate(tag.corners):
                corners[4 * number + k] = place
        return dict(sorted(corners.items()))

    def _upward(self, tags: Sequence[Tag]) -> bool:
        """Whether rows of tags run up the page, as the tags' own corners tell."""
        by_row: dict[int, list[Tag]] = {}
        for tag in tags:
            by_row.setdefault(tag.number // self.columns, []).append(tag)
        first = min(by_row, default=0)
        last = max(by_row, default=0)
        if first == last:
            return False
        middles = [
            np.mean([tag.centre for tag in by_row[row]], axis=0)
            for row in (first, last)
        ]
        down = np.mean([tag.corners[3] - tag.corners[0] for tag in tags], axis=0)
        return bool((middles[1] - middles[0]) @ down < 0.0)


@dataclass(frozen=True)
class Board(Pattern):
    """A chessboard with tags in its white squares; the origin is a corner of the print."""

    columns: int  # squares
    rows: int
    square: float  # side of a square [m]
    marker: float  # side of a tag within it [m]
    dictionary: str = "5x5_100"  # the tags'

    def __post_init__(self) -> None:
        known = len(find_dictionary(self.dictionary).bytesList)
        enough = (self.columns - 1) * (self.rows - 1) >= LEAST_CORNERS
        if not (enough and self.tags <= known and 0.0 < self.marker < self.square):
            raise OptionError(
                f"board {self.text}: expected {LEAST_CORNERS} inner corners or more, tags smaller "
                f"than squares, and at most the {known} tags of {self.dictionary} (here "
                f"{self.tags}); such as 7x5:24mm:18mm:5x5_100"
            )

    @classmethod
    def parse(cls, board: Board | str) -> Board:
        """Read `COLSxROWS:SQUARE:MARKER:DICT`, such as `7x5:24mm:18mm:5x5_100`."""
        made = parse_board(board)
        if not isinstance(made, Board):
            raise OptionError(
                f"board {board!r}: expected a board with tags in its squares, "
                "COLSxROWS:SQUARE:MARKER:DICT, such as 7x5:24mm:18mm:5x5_100"
            )
        return made

    @property
    def side(self) -> float:
        """Side of a square [m]."""
        return self.square

    @property
    def tags(self) -> int:
        """How many tags it has: 0 to one less."""
        return self.columns * self.rows // 2

    @property
    def text(self) -> str:
        """As `parse_board` reads it."""
        sizes = f"{1e3 * self.square:.12g}mm:{1e3 * self.marker:.12g}mm"
        return f"{self.columns}x{self.rows}:{sizes}:{self.dictionary}"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print [m]."""
        return self.columns * self.square, self.rows * self.square

    def opencv(self) -> Any:
        """Return OpenCV's board; its y runs down."""
        return opencv().aruco.CharucoBoard(
            (self.columns, self.rows),
            self.square,
            self.marker,
            find_dictionary(self.dictionary),
        )

    @cached_property
    def printed(self) -> Any:
        """OpenCV's board, made once."""
        return self.opencv()

    @cached_property
    def _detector(self) -> Any:
        return opencv().aruco.CharucoDetector(self.printed)

    def points(self) -> Array:
        """Inner corners (n, 3) by their number [m]."""
        return np.array(self.printed.getChessboardCorners(), float)

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return the corners that a picture shows: number to place (2,) [px]."""
        corners, numbers = self._detector.detectBoard(grey)[:2]
        if numbers is None:
            return {}
        places = np.asarray(corners, float).reshape(-1, 2)
        seen = dict(sorted(zip(np.ravel(numbers).tolist(), places, strict=True)))
        return lay_corners(grey, seen, self.printed)


def parse_board(board: Pattern | str) -> Pattern:
    """Read a board.

    `10x7:22mm` is a plain chessboard: squares across and down, and their side;
    `7x5:24mm:18mm:5x5_100` a ChArUco board: squares, their side, the tags' side, the dictionary;
    `grid:6x6:88mm:26.4mm:t36h11` a grid of AprilTags: tags, their side, the gap, the family.
    """
    if isinstance(board, Pattern):
        return board
    grid = board.startswith("grid:")
    size, *parts = board.removeprefix("grid:").split(":")
    sides = re.fullmatch(r"\s*(\d{1,3})\s*[xX]\s*(\d{1,3})\s*", size)
    least = 2 if grid else 1
    if sides is None or not least <= len(parts) <= 3:
        raise OptionError(
            f"board {board!r}: expected a chessboard's squares COLSxROWS:SQUARE such as "
            "10x7:22mm, COLSxROWS:SQUARE:MARKER:DICT such as 7x5:24mm:18mm:5x5_100, or "
            "grid:COLSxROWS:TAG:GAP:FAMILY such as grid:6x6:88mm:26.4mm:t36h11"
        )
    columns = int(sides[1])
    rows = int(sides[2])
    first = parse_length(parts[0], "board's length")
    if len(parts) == 1:
        return Chessboard(columns, rows, first)
    second = parse_length(parts[1], "board's length")
    if grid:
        return TagGrid(columns, rows, first, second, *parts[2:])
    return Board(columns, rows, first, second, *parts[2:])


class BoardFinder:
    """Finds the corners of a board in pictures."""

    def __init__(self, board: Pattern) -> None:
        self._board = board

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return the corners that a picture shows: number to place (2,) [px]."""
        return self._board.find(grey)


def parse_length(text: str, what: str = "length", *, signed: bool = False) -> float:
    """Return a length [m] above zero, or where `signed` of either sign, such as of "24mm".

    Raises OptionError if the text has no number, or no unit.
    """
    match = re.fullmatch(r"\s*(-?\d*\.?\d+)\s*(mm|cm|m|in)\s*", text)
    value = float(match[1]) / METRES[match[2]] if match else np.nan
    if not (-10.0 if signed else 0.0) < value < 10.0:
        raise OptionError(
            f"{what} {text!r}: expected a number and its unit, such as 24mm"
        )
    return value


def print_tag(number: int, size: float, dictionary: str = DICTIONARY) -> str:
    """Return a tag as SVG whose black square has the side `size` [m]."""
    cells = tag_cells(number, dictionary)
    side = 1e3 * size
    border = max(_MARGIN, side / len(cells))  # a tag needs a cell of white around it
    words = f"{dictionary} {number}, black square {side:g} mm"
    return _page(
        side + 2 * border,
        side + 2 * border,
        _square(cells, border, border, side),
        words,
    )


def print_board(board: Pattern) -> str:
    """Return a board as SVG at its true size."""
    if isinstance(board, Board):
        body = _charuco(board)
        words = f"{board.text}, squares {1e3 * board.square:g} mm"
    elif isinstance(board, TagGrid):
        body = []
        for number, corner in enumerate(1e3 * board.points()[::4]):
            cells = tag_cells(number, board.dictionary)
            body += _square(
                cells, corner[0] + _MARGIN, corner[1] + _MARGIN, 1e3 * board.tag
            )
        words = f"{board.text}, tags {1e3 * board.tag:g} mm"
    elif isinstance(board, Chessboard):
        body = []
        side = 1e3 * board.square
        for x, y in np.ndindex(board.columns, board.rows):
            if (x + y) % 2 == 0:
                body.append(
                    _rectangle(_MARGIN + side * x, _MARGIN + side * y, side, side)
                )
        words = f"{board.text}, squares {side:g} mm, {board.inner[0]}x{board.inner[1]} corners"
    width, height = (1e3 * side + 2 * _MARGIN for side in board.size)
    return _page(width, height, body, words)


def _charuco(board: Board) -> list[str]:
    square = 1e3 * board.square
    body = list[str]()
    # the tags' corners from OpenCV's board, which is what will be looked for
    lows = [
        1e3 * np.asarray(p)[:, :2].min(axis=0) for p in board.printed.getObjPoints()
    ]
    white = {(int(x // square), int(y // square)) for x, y in lows}
    for x, y in np.ndindex(board.columns, board.rows):
        if (x, y) not in white:
            at = _MARGIN + square * x, _MARGIN + square * y
            body += _square(np.zeros((1, 1), bool), *at, square)
    for number, (x, y) in zip(
        np.ravel(board.printed.getIds()).tolist(), lows, strict=True
    ):
        cells = tag_cells(number, board.dictionary)
        body += _square(cells, x + _MARGIN, y + _MARGIN, 1e3 * board.marker)
    return body


def _square(white: Mask, x: float, y: float, side: float) -> list[str]:
    """A black square with white cells (n, n): a rectangle for each run of them in a row."""
    cell = side / len(white)
    made = [_rectangle(x, y, side, side)]
    for row, line in enumerate(white):
        edges = np.flatnonzero(np.diff(np.r_[False, line, False].astype(int)))
        for start, stop in edges.reshape(-1, 2):
            place = x + start * cell, y + row * cell, (stop - start) * cell, cell
            made.append(_rectangle(*place, ' fill="#fff"'))
    return made


def _rectangle(
    x: float, y: float, width: float, height: float, colour: str = ""
) -> str:
    return f'<rect x="{x:.6g}" y="{y:.6g}" width="{width:.6g}" height="{height:.6g}"{colour}/>'


def _page(width: float, height: float, body: list[str], words: str) -> str:
    """A page, below its body a line of 100 mm, and words."""
    return filled(
        __package__,
        "page.svg",
        body="\n".join(body),
        words=words,
        wide=f"{max(width, 116.0):g}",
        high=f"{height + 12:g}",
        line=f"{height + 2:g}",
        foot=f"{height + 7.5:g}",
    )
