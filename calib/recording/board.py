"""A ChArUco board: where its corners are in a picture; boards and tags to print, as SVG."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array, Mask
from ..common.choices import DICTIONARY
from ..common.scale import METRES
from ..common.templates import filled
from ..errors import OptionError
from .pictures import Picture, opencv
from .tags import find_dictionary, lay_corners, tag_cells

LEAST_CORNERS = 8
"""Corners of a board that a picture must show."""

_Printed = tuple[Mask, float, float, float]
"""White cells of a black square, its upper left corner and its side [mm]."""

_MARGIN = 8.0  # [mm] of white around a pattern, beyond its own
_FOOT = 12.0  # [mm] for the line and the words
_LEAST = 116.0  # [mm], width that the line needs


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
        inner, need = (self.columns - 1) * (self.rows - 1), self.columns * self.rows // 2
        known = len(find_dictionary(self.dictionary).bytesList)
        if inner < LEAST_CORNERS or max(self.columns, self.rows) > 100 or need > known:
            raise OptionError(
                f"board {self.columns}x{self.rows} has {inner} inner corners and {need} tags: "
                f"expected {LEAST_CORNERS} corners or more, at most 100 squares each way, and at "
                f"most the {known} tags of {self.dictionary}; such as 7x5:24mm:18mm:5x5_100"
            )
        if not 0.0 < self.marker < self.square:
            raise OptionError(
                f"board: tags of {1e3 * self.marker:g} mm do not fit squares of "
                f"{1e3 * self.square:g} mm; expected COLSxROWS:SQUARE:MARKER:DICT"
            )

    @classmethod
    def parse(cls, text: str) -> Board:
        """Read `COLSxROWS:SQUARE:MARKER:DICT`, such as `7x5:24mm:18mm:5x5_100`."""
        parts = text.split(":")
        size = re.fullmatch(r"\s*(\d{1,3})\s*[xX]\s*(\d{1,3})\s*", parts[0])
        if size is None or len(parts) not in (3, 4):
            raise OptionError(
                f"board {text!r}: expected COLSxROWS:SQUARE:MARKER:DICT, such as "
                "7x5:24mm:18mm:5x5_100"
            )
        square, marker = (parse_length(part, "board's length") for part in parts[1:3])
        return cls(int(size[1]), int(size[2]), square, marker, *parts[3:])

    @classmethod
    def of(cls, board: Board | str) -> Board:
        """A board, or what `parse` reads."""
        return cls.parse(board) if isinstance(board, str) else board

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
        corners = np.asarray(self.opencv().getChessboardCorners(), float)
        up = self.size[1] - corners[:, 1]
        return np.stack([corners[:, 0], up, np.zeros_like(up)], axis=1)


class BoardFinder:
    """Finds the corners of a board in pictures."""

    def __init__(self, board: Board) -> None:
        self.board = board
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
    match = re.fullmatch(r"\s*(-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(mm|cm|m|in)?\s*", text)
    value = float(match[1]) if match else math.nan
    if signed and value == 0.0:
        return 0.0  # of any unit
    if match is None or not match[2] or not (-1e6 if signed else 0.0) < value < 1e6:
        raise OptionError(f"{what} {text!r}: expected a number and its unit, such as 24mm")
    return value / METRES[match[2]]


def print_tag(number: int, size: float, dictionary: str = DICTIONARY) -> str:
    """Return a tag as SVG whose black square has the side `size` [m]."""
    cells, side = tag_cells(number, dictionary), 1e3 * size
    border = max(_MARGIN, side / len(cells))  # a tag needs a cell of white around it
    words = f"{dictionary} {number}, black square {side:g} mm"
    return _page(side + 2 * border, side + 2 * border, [(cells, border, border, side)], words)


def print_board(board: Board) -> str:
    """Return a board as SVG at its true size."""
    square, made = 1e3 * board.square, board.opencv()
    # the tags' corners from OpenCV's board, which is what will be looked for
    lows = [1e3 * np.asarray(points)[:, :2].min(axis=0) for points in made.getObjPoints()]
    taken = {(int(x // square), int(y // square)) for x, y in lows}
    parts: list[_Printed] = [
        (np.zeros((1, 1), bool), _MARGIN + column * square, _MARGIN + row * square, square)
        for row in range(board.rows)
        for column in range(board.columns)
        if (column, row) not in taken
    ]
    for number, (x, y) in zip(np.ravel(made.getIds()).tolist(), lows, strict=True):
        cells = tag_cells(number, board.dictionary)
        parts.append((cells, x + _MARGIN, y + _MARGIN, 1e3 * board.marker))
    width, height = (1e3 * side + 2 * _MARGIN for side in board.size)
    return _page(width, height, parts, f"{board.text}, squares {square:g} mm")


def _page(width: float, height: float, parts: list[_Printed], words: str) -> str:
    """A page with black squares, and on each a white rectangle for each run of white cells."""
    body = []
    for cells, x, y, side in parts:
        cell = side / len(cells)
        body.append(_rectangle(x, y, side, side))
        for row, line in enumerate(cells):
            edges = np.flatnonzero(np.diff(np.r_[False, line, False].astype(int)))
            for start, stop in edges.reshape(-1, 2):
                place = x + start * cell, y + row * cell, (stop - start) * cell, cell
                body.append(_rectangle(*place, ' fill="#fff"'))
    return filled(
        __package__, "page.svg", body="\n".join(body), words=words, wide=f"{max(width, _LEAST):g}",
        high=f"{height + _FOOT:g}", line=f"{height + 2:g}", foot=f"{height + 7.5:g}",
    )  # fmt: skip


def _rectangle(x: float, y: float, width: float, height: float, colour: str = "") -> str:
    return f'<rect x="{x:.6g}" y="{y:.6g}" width="{width:.6g}" height="{height:.6g}"{colour}/>'
