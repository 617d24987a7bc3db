"""Tags and boards to print at their true size: SVG, with a line of ten centimetres to check it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.choices import DICTIONARY
from ..common.templates import filled
from .board import Board
from .tags import tag_cells

_Printed = tuple[NDArray[np.bool_], float, float, float]
"""White cells of a black square, its upper left corner and its side [mm]."""

_MARGIN = 8.0  # [mm] of white around a pattern, beyond its own
_FOOT = 12.0  # [mm] for the line and the words
_LEAST = 116.0  # [mm], width that the line needs


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
