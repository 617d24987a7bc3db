"""Column units: the names of a table's columns, and the units that they state in brackets."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from ..common.scale import METRES
from ..common.wording import listing
from ..errors import LogError

RADIANS = {"rad": 1.0, "deg": math.radians(1.0), "°": math.radians(1.0)}
"""Radians of a unit of angles."""

LENGTHS = {unit: 1.0 / units for unit, units in METRES.items()}
"""Metres of a unit of lengths."""

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds of a unit of time."""

_IN_BRACKETS = re.compile(r"(.*\S)\s*[\[(]\s*([^\s\[\]()]+)\s*[\])]")


def name_and_unit(column: str) -> tuple[str, str]:
    """Return what a column is called, and the unit in brackets behind that, "" without one.

    >>> name_and_unit("x [mm]"), name_and_unit("elbow")
    (('x', 'mm'), ('elbow', ''))
    """
    match = _IN_BRACKETS.fullmatch(column)
    return (match[1], match[2]) if match else (column, "")


def find_column(header: Sequence[str], name: str) -> str | None:
    """Return the column of a name, or the only one with another case or with a unit behind it."""
    if name in header:
        return name
    alike = [
        column
        for column in header
        if name_and_unit(column)[0].casefold() == name.casefold()
    ]
    return alike[0] if len(alike) == 1 else None


def common_unit(columns: Sequence[str]) -> str | None:
    """Return the unit that columns state, None if none does.  Raises LogError for several."""
    units = {name_and_unit(column)[1] for column in columns}
    if len(units) > 1:
        raise LogError(
            f"columns {listing(columns)}: expected positions in one unit"
        )
    return units.pop() or None if units else None


def joint_factor(column: str, *, revolute: bool, degrees: bool) -> float:
    """Return what makes rad or m of a joint's column: by its unit, or whether `degrees` are usual.

    Raises LogError for a unit of joints of the other kind.
    """
    unit = name_and_unit(column)[1]
    choices, others = (RADIANS, LENGTHS) if revolute else (LENGTHS, RADIANS)
    if unit in others:
        raise LogError(
            f"column {column!r} is in {unit}, expected {listing(choices)} of a joint that "
            f"{'turns' if revolute else 'slides'}",
            parameter="prismatic",
        )
    return choices.get(unit, RADIANS["deg"] if revolute and degrees else 1.0)
