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

TABLE1 = {
    "som": dict(
        zip(
            COLUMNS,
            (Printed(2.6, 26.0), Printed(2.9, 29.0), Printed(0.37, 3.45), Printed(0.61, 6.70)),
            strict=True,
        )
    ),
    "vdsom": dict(
        zip(
            COLUMNS,
            (Printed(1.15, 11.7), Printed(1.26, 15.0), Printed(0.31, 2.25), Printed(0.44, 5.36)),
            strict=True,
        )
    ),
}
"""SOM and VDSOM of 70x70 nodes."""

TABLE2 = {
    30: dict(
        zip(
            COLUMNS,
            (Printed(4.16, 36.3), Printed(3.93, 21.1), Printed(0.91, 4.60), Printed(1.53, 7.62)),
            strict=True,
        )
    ),
    50: dict(
        zip(
            COLUMNS,
            (Printed(2.13, 13.5), Printed(2.11, 15.3), Printed(0.52, 2.80), Printed(0.80, 5.05)),
            strict=True,
        )
    ),
    70: TABLE1["vdsom"],
}
"""VDSOM by the nodes along each side of its lattices."""
