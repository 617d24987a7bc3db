"""Sound rows of a log's file: rows that are whole, that a sensor saw, and in range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..arm.urdf import Range
from ..common.arrays import Array, Index, Mask
from ..common.rows import LARGEST, row_lengths
from ..common.wording import listed
from ..errors import LogError
from .joint_values import wrap
from .roles import QUATERNION, ROUNDING, Roles
from .settings import READING


@dataclass(eq=False)
class SoundRows:
    """Rows that are left of a log, and what is said of the others."""

    label: str
    numbers: Index  # (n,), of the rows in the file
    sound: Mask  # (n,)
    notes: list[str] = field(default_factory=list)
    dropped: int = 0  # rows that miss a number
    left_out: int = 0  # rows in which a sensor saw nothing

    def leave_out(self, wrong: Mask, words: str) -> int:
        """Leave out rows (n,), and return how many.  Raises LogError if nothing is left."""
        wrong = wrong & self.sound
        self.sound = self.sound & ~wrong
        count = int(wrong.sum())
        of_all = f"{count:,} of {len(wrong):,} rows {words}"
        if not self.sound.any():
            raise LogError(f"{self.label}: no row is left: {of_all}")
        if count:
            rows = rows_in_words(self.numbers[wrong])
            self.notes.append(f"{of_all}; left out: {rows}")
        return count


def sound_rows(
    label: str,
    values: Array,
    numbers: Index,
    roles: Roles,
    ranges: Mapping[str, Range],
    turning: Mapping[str, bool],
    touched: Mask,
) -> SoundRows:
    """Return which rows of a log are sound.

    values : (n, names), of `roles`; wrong ones and those beyond a turn change
    numbers : (n,), of the rows in the file
    ranges : limits of some joints [rad or m]; rows outside are left out
    turning : which joints turn
    touched : (n,), rows without a measured position
    """
    rows = SoundRows(label, numbers, np.ones(len(values), dtype=bool))
    finite = np.abs(values) < LARGEST
    _, has_position, _ = roles.split(finite)
    has_position[touched] = True
    if roles.touched and not roles.axes:
        finite &= touched[:, None]
    columns = listed(np.array(roles.names)[~finite.all(axis=0)])
    words = f"miss a finite number (2.5, not 2,5) of {columns}"
    rows.dropped = rows.leave_out(np.asarray(~finite.all(axis=1)), words)
    values[~rows.sound] = 0.0
    for name, (low, high) in ranges.items():
        column = values[:, roles.joints.index(name)]
        if turning[name]:
            column[:] = wrap(column, low, high)
        edge = READING.rounded * (high - low)
        away = (column < low - edge) | (column > high + edge)
        rows.leave_out(away, f"have {name} outside of the chosen range")
        np.clip(column, low, high, out=column)
    q, x, turns = roles.split(values)
    zero = rows.sound & (x == 0.0).all(axis=1) & ~touched
    # a single row, or one place of the joints, may be the origin of the sensor
    several = zero.sum() > 1 and np.ptp(q[zero], axis=0).any()
    if several and not zero[rows.sound].all():
        words = "hold zeros for a position, as where a sensor saw nothing"
        rows.left_out = rows.leave_out(zero, words)
    if roles.turns == QUATERNION:
        length = row_lengths(turns)
        wrong = rows.sound & (np.abs(length - 1) > ROUNDING)
        words = f"qx, qy, qz, qw of length {length[np.argmax(wrong)]:.4g}, expected 1"
        rows.left_out += rows.leave_out(wrong, f"hold no orientation: {words}")
    return rows


def rows_in_words(numbers: Index) -> str:
    """Name the first of some numbers of rows."""
    shown = f"{', '.join(map(str, numbers[:5]))}{', ...' if len(numbers) > 5 else ''}"
    return f"row{'s' * (len(numbers) > 1)} {shown}"
