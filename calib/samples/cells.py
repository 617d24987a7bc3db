"""Cells: what stands in the rows of a log, and which rows are sound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..arm.urdf import Range
from ..common.arrays import Array, Index, Mask
from ..common.rows import LARGEST, row_lengths
from ..common.wording import listed
from ..errors import LogError
from .joint_values import JointLimits, wrap
from .motion import directions
from .roles import FURTHER, QUATERNION, ROUNDING, SOCKET, Roles
from .settings import READING
from .tables import Source, rows_in_words


@dataclass(frozen=True, eq=False)
class Cells:
    """What stands in the rows of a log that are held."""

    values: Array  # (n, names), of the roles; angles in rad, NaN where no number stands
    numbers: Index  # (n,), of the rows in the file
    facts: Mapping[str, Array]  # (n,) each, `FURTHER` columns that are there
    points: NDArray[
        np.object_
    ]  # (n, 2), names of setup and point, "" where there is none
    # (n, dof), see `Motion`; None where rows miss joints
    side: Array | None
    notes: list[str]

    @property
    def touched(self) -> Mask:
        """Rows (n,) without a measured position."""
        return np.asarray(self.points[:, 1] != "")

    def further(self, sound: Mask) -> tuple[dict[str, Array], list[str]]:
        """Return the facts that sound rows (n,) have a number of, and notes on the others."""
        facts = {}
        notes = []
        for name, fact in self.facts.items():
            gaps = self.numbers[sound & ~np.isfinite(fact)]
            if len(gaps):
                notes.append(
                    f"the column {name} is not used, it has no number in {len(gaps):,} rows: "
                    f"{rows_in_words(gaps)}"
                )
            else:
                facts[name] = fact[sound]
        return facts, notes


def read_cells(
    source: Source,
    roles: Roles,
    limits: JointLimits,
    most: int,
    seed: int,
) -> Cells:
    """Read a log's rows, at most so many; LogError if it has none."""
    drawn, total = source.drawn(most, seed)
    if not total:
        raise LogError(f"{source.label} has no rows below its header")
    values, numbers = drawn.numbers(roles.columns(roles.names))
    q = values[:, : len(roles.joints)]
    q *= [*limits.factors.values()]
    facts = {}
    time, episode = roles.columns(FURTHER)
    if time in source.header and time not in roles.joints:
        facts["time"] = drawn.seconds(time)
    if episode in source.header and episode not in roles.joints:
        facts["episode"] = drawn.numbers([episode])[0][:, 0]
    notes = []
    side = directions(q) if np.isfinite(q).all() else None
    if total > most:
        notes.append(
            f"{total:,} rows: {most:,} of them, drawn evenly, are held; other counts are of these"
        )
        side = np.zeros(q.shape)  # nobody knows where joints were before
    points = np.full((len(q), 2), "", dtype=object)
    if roles.touched:
        for k, column in enumerate(roles.columns(SOCKET)):
            if column in source.header:
                points[:, k] = drawn.texts(column)
    return Cells(values, numbers, facts, points, side, notes)


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
    cells: Cells,
    roles: Roles,
    ranges: Mapping[str, Range],
    revolute: Mapping[str, bool],
) -> SoundRows:
    """Return which rows of a log are sound.

    cells : their wrong values, and those beyond a turn, change
    ranges : limits of some joints [rad or m]; rows outside are left out
    revolute : which joints turn
    """
    values = cells.values
    touched = cells.touched
    rows = SoundRows(label, cells.numbers, np.ones(len(values), dtype=bool))
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
        if revolute[name]:
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
