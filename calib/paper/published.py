"""What the paper prints: Table 1 and Table 2, mean and largest errors."""

from __future__ import annotations

from typing import NamedTuple


class Printed(NamedTuple):
    """Mean and largest error of one column of a table [mm or deg]."""

    mean: float
    max: float


COLUMNS = ("x", "y", "shoulder", "elbow")
"""Columns of both tables: X, Y, theta_1 and theta_2 by our joints' names."""

UNITS = {"x": "mm", "y": "mm", "shoulder": "deg", "elbow": "deg"}


def _row(*figures: float) -> dict[str, Printed]:
    """Means and largest errors, in turn, of the four columns."""
    pairs = zip(figures[::2], figures[1::2], strict=True)
    return {name: Printed(*pair) for name, pair in zip(COLUMNS, pairs, strict=True)}


TABLE1 = {
    "som": _row(2.6, 26.0, 2.9, 29.0, 0.37, 3.45, 0.61, 6.70),
    "vdsom": _row(1.15, 11.7, 1.26, 15.0, 0.31, 2.25, 0.44, 5.36),
}
"""SOM and VDSOM of 70x70 nodes."""

TABLE2 = {
    30: _row(4.16, 36.3, 3.93, 21.1, 0.91, 4.60, 1.53, 7.62),
    50: _row(2.13, 13.5, 2.11, 15.3, 0.52, 2.80, 0.80, 5.05),
    70: TABLE1["vdsom"],
}
"""VDSOM by the nodes along each side of its lattices."""
