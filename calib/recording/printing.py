"""Printing: boards and tags as SVG at their true size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ..common.wording import fill_template
from .board import BlackSquare, Pattern
from .tags import tag_cells

MARGIN = 8e-3
"""White around a pattern, beyond its own [m]."""

# upper left corner and side [mm]
_RECTANGLE = (
    '<rect x="{0:.6g}" y="{1:.6g}" width="{2:.6g}" height="{2:.6g}"{3}/>'
)


def print_tag(number: int, size: float, dictionary: str) -> str:
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
    body = [row for square in squares for row in _rectangles(square, border)]
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


def _rectangles(square: BlackSquare, border: float) -> Iterator[str]:
    """SVG of a black square and of the white cells upon it."""
    cell = square.side / len(square.white)
    x = square.x + border
    y = square.y + border
    yield _RECTANGLE.format(1e3 * x, 1e3 * y, 1e3 * square.side, "")
    for row, column in np.argwhere(square.white).tolist():
        left = x + column * cell
        top = y + row * cell
        yield _RECTANGLE.format(
            1e3 * left, 1e3 * top, 1e3 * cell, ' fill="#fff"'
        )
