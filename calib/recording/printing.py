"""Tags and boards to print at their true size: SVG, text alone.

`print_tag` and `print_board` return a page; nothing of it is scaled by a program that prints
at 100 %. A line of ten centimetres under the pattern tells whether it was.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.choices import DICTIONARY
from ..common.templates import filled
from .board import Board
from .tags import tag_cells

_Cells = NDArray[np.bool_]

_MARGIN = 8.0  # [mm] of white around a pattern, beyond its own
_FOOT = 12.0  # [mm] for the line and the words


def print_tag(number: int, size: float, dictionary: str = DICTIONARY) -> str:
    """Return a tag as SVG whose black square has the side `size` [m]."""
    cells = tag_cells(number, dictionary)
    side = 1e3 * size
    border = max(_MARGIN, side / len(cells))  # a tag needs a cell of white around it
    words = f"{dictionary} {number}, black square {side:g} mm"
    return _page(side + 2 * border, side + 2 * border, _tag(cells, border, border, side), words)


def print_board(board: Board) -> str:
    """Return a board as SVG at its true size."""
    square, marker = 1e3 * board.square, 1e3 * board.marker
    made = board.opencv()
    # the tags' corners from OpenCV's board, which is what will be looked for
    lows = [1e3 * np.asarray(points)[:, :2].min(axis=0) for points in made.getObjPoints()]
    taken = {(int(low[0] // square), int(low[1] // square)) for low in lows}
    body = [
        _rectangle(_MARGIN + column * square, _MARGIN + row * square, square, square)
        for row in range(board.rows)
        for column in range(board.columns)
        if (column, row) not in taken
    ]
    for number, low in zip(np.ravel(made.getIds()).tolist(), lows, strict=True):
        x, y = low + _MARGIN
        body += _tag(tag_cells(number, board.dictionary), x, y, marker)
    width, height = board.columns * square, board.rows * square
    words = (
        f"{board.columns}x{board.rows}:{square:g}mm:{marker:g}mm:{board.dictionary}, squares "
        f"{square:g} mm"
    )
    return _page(width + 2 * _MARGIN, height + 2 * _MARGIN, body, words)


def _tag(cells: _Cells, x: float, y: float, side: float) -> list[str]:
    """Return a black square, and on it a white rectangle for each run of white cells in a row."""
    parts, cell = [_rectangle(x, y, side, side)], side / len(cells)
    for row, line in enumerate(cells):
        edges = np.flatnonzero(np.diff(np.r_[False, line, False].astype(int)))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            place = x + start * cell, y + row * cell, (stop - start) * cell, cell
            parts.append(_rectangle(*place, ' fill="#fff"'))
    return parts


def _rectangle(x: float, y: float, width: float, height: float, colour: str = "") -> str:
    return f'<rect x="{x:.6g}" y="{y:.6g}" width="{width:.6g}" height="{height:.6g}"{colour}/>'


def _page(width: float, height: float, body: list[str], words: str) -> str:
    sides = {"wide": f"{max(width, 116.0):g}", "high": f"{height + _FOOT:g}"}
    line, foot = f"{height + 2:g}", f"{height + 7.5:g}"
    shapes = "\n".join(body)
    return filled(__package__, "page.svg", body=shapes, words=words, line=line, foot=foot, **sides)
