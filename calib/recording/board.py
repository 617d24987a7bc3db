"""A ChArUco board: where its corners are in a picture; boards and tags to print, as SVG."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array, Mask
from ..common.choices import DICTIONARY
from ..common.scale import METRES
from ..common.wording import filled
from ..errors import OptionError
from .pictures import Picture, opencv
from .tags import find_dictionary, lay_corners, tag_cells

LEAST_CORNERS = 8
"""Corners of a board that a picture must show."""

_MARGIN = 8.0  # [mm] of white around a pattern, beyond its own


@dataclass(frozen=True)
class Board:
    """A chessboard with tags in its white squares.

    Its frame: origin at the lower left corner of the print, x to the right, y up, z out of the
    paper.
    """

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
        if isinstance(board, Board):
            return board
        size, *parts = board.split(":")
        sides = re.fullmatch(r"\s*(\d{1,3})\s*[xX]\s*(\d{1,3})\s*", size)
        if sides is None or len(parts) not in (2, 3):
            raise OptionError(
                f"board {board!r}: expected COLSxROWS:SQUARE:MARKER:DICT, such as "
                "7x5:24mm:18mm:5x5_100"
            )
        square, marker = (parse_length(part, "board's length") for part in parts[:2])
        return cls(int(sides[1]), int(sides[2]), square, marker, *parts[2:])

    @property
    def tags(self) -> int:
        """How many tags it has: 0 to one less."""
        return self.columns * self.rows // 2

    @property
    def text(self) -> str:
        """As `parse` reads it."""
        square, marker = 1e3 * self.square, 1e3 * self.marker
        return f"{self.columns}x{self.rows}:{square:.12g}mm:{marker:.12g}mm:{self.dictionary}"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print [m]."""
        return self.columns * self.square, self.rows * self.square

    def opencv(self) -> Any:
        """Return OpenCV's board; its y runs down."""
        return opencv().aruco.CharucoBoard(
            (self.columns, self.rows), self.square, self.marker, find_dictionary(self.dictionary)
        )

    def corners(self) -> Array:
        """Return the inner corners (n, 3) in the board's frame [m], by their number."""
        corners = np.array(self.opencv().getChessboardCorners(), float)
        corners[:, 1] = self.size[1] - corners[:, 1]
        return corners


class BoardFinder:
    """Finds the corners of a board in pictures."""

    def __init__(self, board: Board) -> None:
        self._printed = board.opencv()
        self._detector = opencv().aruco.CharucoDetector(self._printed)

    def find(self, grey: Picture) -> dict[int, Array]:
        """Return the corners that a picture shows: number to place (2,) [px]."""
        corners, numbers = self._detector.detectBoard(grey)[:2]
        if numbers is None:
            return {}
        places = np.asarray(corners, float).reshape(-1, 2)
        found = dict(sorted(zip(np.ravel(numbers).tolist(), places, strict=True)))
        return lay_corners(grey, found, self._printed)


def parse_length(text: str, what: str = "length", *, signed: bool = False) -> float:
    """Return a length [m] above zero, or where `signed` of either sign, such as of "24mm".

    Raises OptionError if the text has no number, or no unit.
    """
    match = re.fullmatch(r"\s*(-?\d*\.?\d+)\s*(mm|cm|m|in)\s*", text)
    value = float(match[1]) / METRES[match[2]] if match else np.nan
    if not (-10.0 if signed else 0.0) < value < 10.0:
        raise OptionError(f"{what} {text!r}: expected a number and its unit, such as 24mm")
    return value


def print_tag(number: int, size: float, dictionary: str = DICTIONARY) -> str:
    """Return a tag as SVG whose black square has the side `size` [m]."""
    cells, side = tag_cells(number, dictionary), 1e3 * size
    border = max(_MARGIN, side / len(cells))  # a tag needs a cell of white around it
    words = f"{dictionary} {number}, black square {side:g} mm"
    return _page(side + 2 * border, side + 2 * border, _square(cells, border, border, side), words)


def print_board(board: Board) -> str:
    """Return a board as SVG at its true size."""
    square, made, body = 1e3 * board.square, board.opencv(), list[str]()
    # the tags' corners from OpenCV's board, which is what will be looked for
    lows = [1e3 * np.asarray(points)[:, :2].min(axis=0) for points in made.getObjPoints()]
    white = {(int(x // square), int(y // square)) for x, y in lows}
    for x, y in np.ndindex(board.columns, board.rows):
        if (x, y) not in white:
            at = _MARGIN + square * x, _MARGIN + square * y
            body += _square(np.zeros((1, 1), bool), *at, square)
    for number, (x, y) in zip(np.ravel(made.getIds()).tolist(), lows, strict=True):
        cells = tag_cells(number, board.dictionary)
        body += _square(cells, x + _MARGIN, y + _MARGIN, 1e3 * board.marker)
    width, height = (1e3 * side + 2 * _MARGIN for side in board.size)
    return _page(width, height, body, f"{board.text}, squares {square:g} mm")


def _square(white: Mask, x: float, y: float, side: float) -> list[str]:
    """A black square with white cells (n, n): a rectangle for each run of them in a row."""
    cell, made = side / len(white), [_rectangle(x, y, side, side)]
    for row, line in enumerate(white):
        edges = np.flatnonzero(np.diff(np.r_[False, line, False].astype(int)))
        for start, stop in edges.reshape(-1, 2):
            place = x + start * cell, y + row * cell, (stop - start) * cell, cell
            made.append(_rectangle(*place, ' fill="#fff"'))
    return made


def _rectangle(x: float, y: float, width: float, height: float, colour: str = "") -> str:
    return f'<rect x="{x:.6g}" y="{y:.6g}" width="{width:.6g}" height="{height:.6g}"{colour}/>'


def _page(width: float, height: float, body: list[str], words: str) -> str:
    """A page, below its body a line of 100 mm, and words."""
    return filled(
        __package__, "page.svg", body="\n".join(body), words=words,
        wide=f"{max(width, 116.0):g}", high=f"{height + 12:g}", line=f"{height + 2:g}",
        foot=f"{height + 7.5:g}",
    )  # fmt: skip
