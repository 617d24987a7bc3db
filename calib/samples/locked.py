"""Locked joints of a log: where the joints that are not learned stood, and whether they moved."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence

import numpy as np

from ..errors import LogError
from .columns import Source, open_source, read_rows
from .measured_rows import HELD_ROWS

_STANDS = {True: math.radians(5.0), False: 2e-2}  # further it takes part [rad, m]
_SOME = 0.02  # share of rows in which it may do so: wrong readings
_STILL = {True: math.radians(0.5), False: 1e-3}  # a locked joint may move [rad, m]


def locked_from_log(
    path: str | os.PathLike[str] | Source,
    names: Sequence[str],
    *,
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    prismatic: Sequence[str] = (),
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Find where the locked joints stood while a log was recorded.

    path, columns, degrees, prismatic : as of `read_log`
    names : joints that are not active. Those without a column are passed over.
    Returns values : [rad or m], the median of each joint's column, for `load_arm(..., lock=values)`
    Returns notes : a warning for each joint that moved more than 0.5 deg or 1 mm from it
    """
    source = open_source(path)
    used = {name: (columns or {}).get(name, name) for name in names}
    found = [name for name in names if used[name] != name or name in source]
    if not found:
        return {}, ()
    read = read_rows(source, [used[name] for name in found], most=HELD_ROWS)
    values, notes = {}, []
    for name, column in zip(found, read.values.T, strict=True):
        there = np.isfinite(column)
        recorded, numbers = column[there], read.numbers[there]
        if not len(numbers):
            continue
        turns = name not in prismatic
        stood = np.deg2rad(recorded) if turns and degrees else recorded
        values[name] = float(np.median(stood))
        off = np.abs(stood - values[name])
        moved = float(off.max())
        shown = f"{math.degrees(moved):.3g} deg" if turns else f"{1e3 * moved:.3g} mm"
        if np.mean(off > _STANDS[turns]) > _SOME:
            raise LogError(
                f"{source.label}: {name} is locked but moved by up to {shown} (row "
                f"{numbers[np.argmax(off)]})",
                hint="name it in `joints` too, without `planar` if its axis is not parallel to the "
                "others', or leave out the rows in which it moved",
                parameter="joints",
                value=name,
            )
        if moved > _STILL[turns]:
            notes.append(
                f"{source.label}: {name} is taken as locked but moved by up to {shown}; "
                "leave out those rows, or name it in `joints`"
            )
    return values, tuple(notes)
