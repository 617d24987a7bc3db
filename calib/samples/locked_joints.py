"""Locked joints: the values of those that are not active while a log was recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..common.arrays import Array, Index
from ..common.wording import for_people
from ..errors import LogError
from .column_units import find_column, joint_factor
from .settings import SLIDING, TURNING
from .tables import Source


def locked_joint_values(
    source: Source,
    names: Sequence[str],
    *,
    columns: Mapping[str, str],
    degrees: bool,
    prismatic: Sequence[str],
) -> tuple[dict[str, float], list[str]]:
    """Find the values of the locked joints while a log was recorded.

    columns, degrees, prismatic : see `read_log`
    names : joints that are not active. Those without a column are passed over.
    Returns values : [rad or m], the median of each joint's column, for `load_arm(..., lock=values)`
    Returns notes : a warning for each joint that moved more than 0.5 deg or 1 mm from it
    """
    values: dict[str, float] = {}
    notes: list[str] = []
    for name in names:
        typed = columns.get(name)
        column = find_column(source.header, typed or name) or typed
        if column is None:
            continue
        revolute = name not in prismatic
        stood = source.numbers([column])[:, 0] * joint_factor(
            column, revolute=revolute, degrees=degrees
        )
        if np.isfinite(stood).any():
            values[name] = float(np.nanmedian(stood))
            off = np.nan_to_num(np.abs(stood - values[name]))
            label = f"{source.label}: {name}"
            notes += _notes_on_motion(
                label, name, off, source.row_numbers, revolute=revolute
            )
    return values, notes


def _notes_on_motion(
    label: str, name: str, off: Array, rows: Index, *, revolute: bool
) -> list[str]:
    """Notes on a locked joint that moved by `off` (n,) [rad or m]; refuse one that takes part.

    rows : (n,), their numbers in the file
    """
    tolerance = TURNING if revolute else SLIDING
    factor, unit = for_people("rad" if revolute else "m")
    most = f"{factor * off.max():.3g} {unit}"
    words = f"{label} is locked but moved by up to {most}"
    if np.mean(off > tolerance.locked) > tolerance.most_rows:
        raise LogError(
            f"{words} (row {rows[np.argmax(off)]})",
            hint="name it in `joints` too, without `planar` if its axis is not parallel to the "
            "others', or leave out the rows in which it moved",
            parameter="joints",
            value=name,
        )
    if off.max() <= tolerance.still:
        return []
    return [f"{words}; leave out those rows, or name it in `joints`"]
