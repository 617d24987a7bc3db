"""Printing: boards and tags as SVG at their true size."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..common.choices import DICTIONARY
from ..common.wording import fill_template
from .board import BlackSquare, Pattern
from .tags import tag_cells

MARGIN = 8e-3
"""White around a pattern, beyond its own [m]."""


def print_tag(number: int, size: float, dictionary: str = DICTIONARY) -> str:
    """Return a tag as SVG whose black square has the side `size` [m]."""
    cells = tag_cells(number, dictionary)
    # a tag needs a cell of white around it
    border = max(MARGIN, size / len(cells))
    words = f"{dictionary} {number}, black square {1e3 * size:g} mm"
    return _page(
        [BlackSquare(0.0, 0.0, size, cells)], (size, size), border, words
    )


def print_board(board: Pattern) -> str:
    """Return a board as SVG at its true size."""
    words = f"{board.text}, side {1e3 * board.side:g} mm"
    return _page(board.black_squares(), board.size, MARGIN, words)


def _page(
    squares: Iterable[BlackSquare],
    size: tuple[float, float],
    border: float,
    words: str,
) -> str:
    """A page, below its squares a line of 100 mm, and words."""
    body = []
    for square in squares:
        body += _rectangles(square, border)
    width, height = (1e3 * (side + 2 * border) for side in size)
    return fill_template(
        __package__,
        "page.svg",
        body="\n".join(body),
        words=words,
        wide=f"{max(width, 116.0):g}",
        high=f"{height + 12:g}",
        line=f"{height + 2:g}",
        foot=f"{height + 7.5:g}",
    )


def _rectangles(square: BlackSquare, border: float) -> list[str]:
    """SVG of a black square and of the white cells upon it."""
    cell = square.side / len(square.white)
    left = square.x + border
    top = square.y + border
    rectangles = [_rectangle(left, top, square.side)]
    for row, column in np.argwhere(square.white).tolist():
        x = left + column * cell
        y = top + row * cell
        rectangles.append(_rectangle(x, y, cell, ' fill="#fff"'))
    return rectangles


def _rectangle(x: float, y: float, side: float, fill: str = "") -> str:
    """SVG of a square by its upper left corner and its side [m]."""
    x, y, side = (1e3 * length for length in (x, y, side))
    return f'<rect x="{x:.6g}" y="{y:.6g}" width="{side:.6g}" height="{side:.6g}"{fill}/>'
