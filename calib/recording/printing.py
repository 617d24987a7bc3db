"""Printing: boards and tags as SVG at their true size."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..common.choices import DICTIONARY
from ..common.wording import fill_template
from .board import Mark, Pattern
from .tags import tag_cells

MARGIN = 8e-3
"""White around a pattern, beyond its own [m]."""


def print_tag(number: int, size: float, dictionary: str = DICTIONARY) -> str:
    """Return a tag as SVG whose black square has the side `size` [m]."""
    cells = tag_cells(number, dictionary)
    border = max(
        MARGIN, size / len(cells)
    )  # a tag needs a cell of white around it
    words = f"{dictionary} {number}, black square {1e3 * size:g} mm"
    return _page([Mark(0.0, 0.0, size, cells)], (size, size), border, words)


def print_board(board: Pattern) -> str:
    """Return a board as SVG at its true size."""
    words = f"{board.text}, side {1e3 * board.side:g} mm"
    return _page(board.marks(), board.size, MARGIN, words)


def _page(
    marks: Iterable[Mark], size: tuple[float, float], border: float, words: str
) -> str:
    """A page, below its marks a line of 100 mm, and words."""
    body = []
    for mark in marks:
        body += _squares(mark, border)
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


def _squares(mark: Mark, border: float) -> list[str]:
    """A black square, and its white cells upon it."""
    cell = mark.side / len(mark.white)
    left = mark.x + border
    top = mark.y + border
    squares = [_square(left, top, mark.side)]
    for row, column in np.argwhere(mark.white).tolist():
        x = left + column * cell
        y = top + row * cell
        squares.append(_square(x, y, cell, ' fill="#fff"'))
    return squares


def _square(x: float, y: float, side: float, fill: str = "") -> str:
    """A square, its corner and its side [m]."""
    x, y, side = (1e3 * length for length in (x, y, side))
    return f'<rect x="{x:.6g}" y="{y:.6g}" width="{side:.6g}" height="{side:.6g}"{fill}/>'
