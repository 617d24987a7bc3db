"""Cells: the contents of a log's rows, and the sound ones among these rows.

Rows are left out in this order: those that miss a number; those outside of chosen ranges, into
which others are wrapped; those in which the sensor saw nothing, for which joints have to be right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import QUATERNION
from ..common.arrays import Array, Index, Mask, Range
from ..common.inputs import LARGEST
from ..common.rows import row_lengths, spread_rows
from ..common.wording import listing
from ..errors import LogError
from .joint_values import JointColumn, wrap
from .motion import RowArrays, directions, new_rows
from .roles import FURTHER, SOCKET, Roles
from .settings import READING
from .tables import Source, rows_in_words


@dataclass(frozen=True, eq=False)
class Cells(RowArrays):
    """The values of some rows of a log."""

    label: str  # what messages call the log
    total: int  # rows that the log has, or that are held of it
    # NaN where there is no number
    q: Array  # (n, dof) [rad or m], joint values
    x: Array  # (n, m), positions; none in a log of touches alone
    orientation: Array  # (n, 4) quaternions, (n, 3) angles or (n, 0)
    numbers: Index  # (n,), of the rows in the file
    # (n, 2), names of setup and point, "" where there is none
    points: NDArray[np.object_]
    # (n, dof), see `Motion`; None where rows miss joints
    side: Array | None
    time: Array | None = None  # (n,) [s]
    episode: Array | None = None  # (n,)
    dropped: int = 0  # rows that missed a number
    left_out: int = 0  # rows in which the sensor saw nothing
    notes: tuple[str, ...] = ()

    @property
    def is_measured(self) -> Mask:
        """Rows (n,) that are no touch: a sensor measured the position."""
        return np.asarray(self.points[:, 1] == "")

    def without(self, unsound: Mask, words: str) -> Cells:
        """Leave out rows (n,), with a note.  Raises LogError if nothing is left."""
        if not unsound.any():
            return self
        of_all = f"{unsound.sum():,} of {self.total:,} rows {words}"
        if unsound.all():
            raise LogError(f"{self.label}: no row is left: {of_all}")
        rows = rows_in_words(self.numbers[unsound])
        note = f"{of_all}; left out: {rows}"
        return replace(self.take(~unsound), notes=(*self.notes, note))

    def without_gaps(self) -> Cells:
        """Leave out times and episodes that some rows have no number of, with a note."""
        cells = self
        for name in FURTHER:
            column = getattr(self, name)
            if column is None or np.isfinite(column).all():
                continue
            gaps = self.numbers[~np.isfinite(column)]
            note = (
                f"the column {name} is not used, it has no number in {len(gaps):,} rows: "
                f"{rows_in_words(gaps)}"
            )
            unused: dict[str, Any] = {name: None}
            cells = replace(cells, notes=(*cells.notes, note), **unused)
        return cells


def sound_cells(
    source: Source,
    roles: Roles,
    joints: Sequence[JointColumn],
    ranges: Mapping[str, Range],
) -> Cells:
    """Read a log's sound rows, see above.  Raises LogError if it has none.

    ranges : chosen by the user for some joints [rad or m]
    """
    cells = read_cells(source, roles, joints)
    complete = complete_rows(cells, roles)
    inside = rows_in_ranges(complete, joints, ranges)
    sound = rows_in_sight(inside).without_gaps()
    dropped = len(cells.numbers) - len(complete.numbers)
    left_out = len(inside.numbers) - len(sound.numbers)
    return replace(sound, dropped=dropped, left_out=left_out)


def read_cells(
    source: Source, roles: Roles, joints: Sequence[JointColumn]
) -> Cells:
    """Read a log's rows, of a very long one evenly spread ones; LogError if it has none."""
    total = len(source.table)
    if not total:
        raise LogError(f"{source.label} has no rows below its header")
    rows = spread_rows(total, READING.most_rows)
    spread = replace(source, table=source.table[rows])
    values = spread.numbers(roles.columns(roles.names))
    counts = (len(roles.joints), len(roles.axes))
    q, x, orientation = np.split(values, np.cumsum(counts), axis=1)
    q *= [joint.factor for joint in joints]
    points = np.full((len(q), 2), "", object)
    if roles.touched:
        for k, column in enumerate(roles.columns(SOCKET)):
            if column in source.header:
                points[:, k] = spread.texts(column)
    side = directions(q) if np.isfinite(q).all() else None
    notes: tuple[str, ...] = ()
    if len(q) < total:
        words = f"{total:,} rows: {len(q):,} of them, evenly spread, are held"
        notes = (f"{words}; other counts are of these",)
    cells = Cells(
        source.label,
        len(q),
        q,
        x,
        orientation,
        spread.row_numbers,
        points,
        side,
        notes=notes,
    )
    time, episode = roles.columns(FURTHER)
    others = {*source.header} - {*roles.columns(roles.names)}
    if time in others:
        cells = replace(cells, time=spread.seconds(time))
    if episode in others:
        cells = replace(cells, episode=spread.numbers([episode])[:, 0])
    return cells


def complete_rows(cells: Cells, roles: Roles) -> Cells:
    """Leave out rows that miss a number."""
    values = np.hstack([cells.q, cells.x, cells.orientation])
    finite = np.abs(values) < LARGEST
    touched = ~cells.is_measured
    dof = len(roles.joints)
    finite[touched, dof : dof + len(roles.axes)] = True
    if roles.touched and not roles.axes:
        finite &= touched[:, None]
    columns = listing(np.array(roles.names)[~finite.all(axis=0)])
    words = f"miss a finite number (2.5, not 2,5) of {columns}"
    return cells.without(np.asarray(~finite.all(axis=1)), words)


def rows_in_ranges(
    cells: Cells, joints: Sequence[JointColumn], ranges: Mapping[str, Range]
) -> Cells:
    """Leave out rows outside of ranges of some joints [rad or m]; others are wrapped into them."""
    for k, joint in enumerate(joints):
        if joint.name not in ranges:
            continue
        low, high = ranges[joint.name]
        q = cells.q.copy()
        column = q[:, k]
        if joint.revolute:
            column[:] = wrap(column, low, high)
        edge = READING.rounded * (high - low)
        away = (column < low - edge) | (column > high + edge)
        np.clip(column, low, high, out=column)
        words = f"have {joint.name} outside of the chosen range"
        cells = replace(cells, q=q).without(away, words)
    return cells


def rows_in_sight(cells: Cells) -> Cells:
    """Leave out rows in which the sensor saw nothing, or no orientation."""
    zero = (cells.x == 0.0).all(axis=1) & cells.is_measured
    # a single row may be the origin of the sensor
    if zero.sum() > 1 and not zero.all():
        words = "hold zeros for a position, as where a sensor saw nothing"
        cells = cells.without(zero, words)
    if cells.is_measured.all():
        words = (
            "repeat the position of the row before although the joints moved, as where a sensor "
            "holds its last value"
        )
        cells = cells.without(repeated_readings(cells.q, cells.x), words)
    if cells.is_measured.all():
        words = (
            "repeat the joints of the row before although the positions moved on, as where joints "
            "are read less often"
        )
        cells = cells.without(repeated_joints(cells.q, cells.x), words)
    if cells.orientation.shape[1] != len(QUATERNION):
        return cells
    length = row_lengths(cells.orientation)
    wrong = np.abs(length - 1) > READING.rounded_length
    words = (
        f"qx, qy, qz, qw of length {length[np.argmax(wrong)]:.4g}, expected 1"
    )
    return cells.without(wrong, f"hold no orientation: {words}")


def repeated_readings(q: Array, x: Array) -> Mask:
    """Return rows (n,) that read as the row before to the last digit although the joints moved."""
    is_new = new_rows(x)
    if is_new.all():
        return ~is_new
    moved = row_lengths(np.diff(q, axis=0))
    usual = moved[is_new[1:]].mean()
    # from the row in which the sensor read this first
    first = np.flatnonzero(is_new)[np.cumsum(is_new) - 1]
    away = row_lengths(q - q[first])
    return np.asarray(~is_new & (away > READING.moved * usual))


def repeated_joints(q: Array, x: Array) -> Mask:
    """Return rows (n,) that repeat the joints of the row before, where positions then move on.

    Positions at rest scatter about one place; a step in motion is a third of three.
    """
    rows = np.flatnonzero(repeated_readings(x, q)[2:-1]) + 2
    if len(rows) < READING.fewest_followers:
        return np.zeros(len(q), bool)
    step = x[rows] - x[rows - 1]
    around = x[rows + 1] - x[rows - 2]
    size = np.maximum(row_lengths(around), 1e-300)
    share = (step * around).sum(axis=1) / size**2
    in_motion = np.median(share) > READING.follows
    return np.asarray(~new_rows(q) & in_motion)
