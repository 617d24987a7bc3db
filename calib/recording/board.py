"""A ChArUco board: what is printed on it, and where its corners are in a picture."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.scale import METRES
from ..errors import OptionError
from .opencv import Picture, opencv
from .patterns import lay_corners
from .tags import find_dictionary

LEAST_CORNERS = 8
"""Corners of a board that a picture must show."""


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
        name = f"board {self.columns}x{self.rows}"
        inner, need = (self.columns - 1) * (self.rows - 1), self.columns * self.rows // 2
        known = len(find_dictionary(self.dictionary).bytesList)
        refusals = {
            f"{name} has {inner} inner corners, expected {LEAST_CORNERS} or more, of at most 100 "
            "squares each way: such as 5x4": (
                inner < LEAST_CORNERS or max(self.columns, self.rows) > 100
            ),
            f"board: tags of {1e3 * self.marker:g} mm do not fit squares of "
            f"{1e3 * self.square:g} mm; expected COLSxROWS:SQUARE:MARKER:DICT": not (
                0.0 < self.marker < self.square
            ),
            f"{name} needs {need} tags, {self.dictionary} has {known}: take a larger dictionary": (
                need > known
            ),
        }
        for message, wrong in refusals.items():
            if wrong:
                raise OptionError(message)

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
        best = self._detect(grey)
        if len(best) < LEAST_CORNERS:  # cells of two pixels are read at twice the size
            cv2 = opencv()
            large = cv2.resize(grey, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_CUBIC)
            # pixel centres have whole coordinates: doubling puts them half a pixel off
            larger = {n: 0.5 * (place - 0.5) for n, place in self._detect(large).items()}
            best = max(best, larger, key=len)
        return lay_corners(grey, best, self._printed)

    def _detect(self, grey: Picture) -> dict[int, Array]:
        corners, numbers = self._detector.detectBoard(grey)[:2]
        if numbers is None:
            return {}
        places = np.asarray(corners, float).reshape(-1, 2)
        return dict(zip(np.ravel(numbers).tolist(), places, strict=True))


def parse_length(text: str, what: str = "length", *, signed: bool = False) -> float:
    """Return a length [m] above zero, or where `signed` of either sign, such as of "24mm".

    Raises OptionError if the text has no number, or no unit.
    """
    match = re.fullmatch(r"\s*(-?[0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(mm|cm|m|in)?\s*", text)
    try:
        value = float(match[1]) if match else math.nan
    except ValueError:
        value = math.nan
    if signed and value == 0.0:
        return 0.0  # of any unit
    if match is None or not match[2] or not (-1e6 if signed else 0.0) < value < 1e6:
        raise OptionError(f"{what} {text!r}: expected a number and its unit, such as 24mm")
    return value / METRES[match[2]]
