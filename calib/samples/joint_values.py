"""Joint values: a plausible range and unit, the direction of approach, values between two times.

Use it on a table of queries, a trajectory to correct or a log: one check for all of them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.urdf import Range
from ..common.arrays import Array, Index, Mask
from ..common.rows import LARGEST
from ..common.scale import TURN
from ..common.wording import for_people, unit_of_joint
from ..errors import CalibError, LogError, OptionError
from . import settings
from .tables import Source, open_source

MAX_GAP = 0.1
"""Joints further apart than this are not interpolated between [s]."""

SETTLE = 0.04
"""Time before and after, over which a joint's speed is taken: encoders count in steps [s]."""

_MOST_TURNS = (
    4.0  # further from zero a joint value is in degrees, or not reset for long
)


def check_joint_values(
    q: Array,
    names: Sequence[str],
    lower: Array,
    upper: Array,
    revolute: Sequence[bool],
    *,
    degrees: bool = False,
    label: str = "joint values",
    error: type[CalibError] = LogError,
) -> None:
    """Refuse joint values that can only be of another unit than was said.

    Values a little outside of the range pass: whoever uses them says what becomes of them.

    q : (n, dof) [rad or m], joint values; rows that are not finite are passed over
    lower, upper : (dof,) [rad or m], the joints' learned range
    degrees : whether the values were given in degrees, and converted
    """
    rows = np.flatnonzero(np.isfinite(q).all(axis=1))
    for k in np.flatnonzero(revolute).tolist() if len(rows) else ():
        limits = float(lower[k]), float(upper[k])
        LoggedJoint(label, names[k], True, limits, degrees, error).check_unit(
            q[rows, k], rows + 1
        )


@dataclass(frozen=True)
class LoggedJoint:
    """One joint of a log or a table, and what is known of its range."""

    label: str  # what messages call the table
    name: str
    revolute: bool
    limits: Range | None  # the arm's, or what the user asked for [rad or m]
    degrees: bool = False  # whether the table and the messages are in degrees
    error: type[CalibError] = LogError

    def check_unit(self, values: Array, rows: Index) -> None:
        """Refuse angles (n,) [rad] of another unit: too many turns, or in range as degrees."""
        low = float(values.min())
        high = float(values.max())
        most = max(abs(low), abs(high))
        fits = False
        if (
            self.limits and not self.degrees and most > TURN
        ):  # small ones look like degrees too
            as_degrees = beyond(np.deg2rad(values), *self.limits)
            fits = beyond(values, *self.limits) > settings.SLACK >= as_degrees
        if fits or high - low > 2.02 * TURN or most > _MOST_TURNS * TURN:
            says = "as degrees it fits: give" if fits else "if it is in degrees, give"
            hint = (
                "it is in rad: leave out `degrees`"
                if self.degrees
                else f"{says} `degrees=True`"
            )
            limits = self.limits or (-math.pi, math.pi)
            raise self._outside(values, rows, limits, hint, "degrees", self.degrees)

    def settle(self, values: Array, rows: Index) -> tuple[Array, Range, list[str]]:
        """Return values (n,) [rad or m], wrapped where needed, the joint's range, and notes.

        rows : (n,), their numbers in the file
        """
        low = float(values.min())
        high = float(values.max())
        if self.limits is None and not self.revolute:
            return values, (low, high), []
        limits = self.limits or (-math.pi, math.pi)
        moved = values
        full = self.revolute and limits[1] - limits[0] >= TURN - 1e-9
        excess = beyond(values, *limits)
        if self.revolute and excess > 0:
            self.check_unit(values, rows)
        if full and high - low <= TURN:  # the log's own turn, whatever its gaps
            middle = (low + high) / 2.0
            own = limits if excess < 1e-9 else (middle - math.pi, middle + math.pi)
            return np.clip(values, *own), own if self.limits else (low, high), []
        if self.revolute and (full or excess > settings.SLACK):
            moved = wrap(values, *limits)
            excess = beyond(moved, *limits)
        if excess > settings.SLACK:
            hint = "check that the column is of this joint, its unit and its sign; if the joint "
            hint += f"really goes there, give `ranges={{{self.name!r}: (LOW, HIGH)}}`"
            raise self._outside(values, rows, limits, hint, "ranges")
        limits = min(limits[0], float(moved.min())), max(limits[1], float(moved.max()))
        notes = []
        if turned := int(np.count_nonzero(np.abs(moved - values) > 1.0)):
            notes = [f"{self.name}: {turned} values wrapped by whole turns"]
        if excess > settings.ROUNDED:
            notes.append(
                f"{self.name}: the log goes beyond the limits; range {self._show(*limits)}"
            )
        return moved, limits, notes

    def _show(self, *values: float) -> str:
        """Values [rad or m] in the unit of the table."""
        factor, unit = unit_of_joint(self.revolute, self.degrees)
        return f"{'..'.join(f'{factor * value:.6g}' for value in values)} {unit}"

    def _outside(
        self,
        values: Array,
        rows: Index,
        limits: Range,
        hint: str,
        parameter: str,
        value: Any = None,
    ) -> CalibError:
        """The error for the value (n,) furthest outside of a range, with the remedy."""
        row = int(np.argmax(np.maximum(limits[0] - values, values - limits[1])))
        words = f"{self.name} is {self._show(values[row])}, outside of the range"
        return self.error(
            f"{self.label}, row {rows[row]}: {words} {self._show(*limits)}",
            hint=hint,
            parameter=parameter,
            value=float(values[row]) if value is None else value,
        )


def beyond(values: Array, low: float, high: float) -> float:
    """Return by how much values (n,) leave a range, as a share of its width."""
    return max(low - float(values.min()), float(values.max()) - high, 0.0) / (
        high - low
    )


def check_ranges(ranges: Mapping[str, Range], revolute: Mapping[str, bool]) -> None:
    """Raise OptionError for a joint's range that is none, or more than a turn [rad or m]."""
    for name, (low, high) in ranges.items():
        if not 0 < high - low <= (TURN + 1e-4 if revolute.get(name) else LARGEST):
            raise OptionError(
                f"range {name}={low:g}:{high:g}: expected low:high with low below high, of a joint "
                "that turns one turn at most [rad]",
                parameter="ranges",
                value=(low, high),
            )


def wrap(values: Array, low: float, high: float) -> Array:
    """Move the angles (n,) outside of a range by whole turns to where they are nearest to it."""
    moved = low + np.mod(values - low, TURN)
    # An angle just below the range is nearer to it than a turn later.
    moved = np.where(
        moved - high > TURN / 2.0 - (high - low) / 2.0, moved - TURN, moved
    )
    moved = np.where(high - low >= TURN - 1e-9, np.clip(moved, low, high), moved)
    return np.where((values < low) | (values > high), moved, values)


def locked_from_log(
    path: str | os.PathLike[str] | Source,
    names: Sequence[str],
    *,
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    prismatic: Sequence[str] = (),
) -> tuple[dict[str, float], list[str]]:
    """Find where the locked joints stood while a log was recorded.

    path, columns, degrees, prismatic : as of `read_log`
    names : joints that are not active. Those without a column are passed over.
    Returns values : [rad or m], the median of each joint's column, for `load_arm(..., lock=values)`
    Returns notes : a warning for each joint that moved more than 0.5 deg or 1 mm from it
    """
    source = open_source(path)
    called = columns or {}
    found = {n: called.get(n, n) for n in names if n in called or n in source.header}
    if not found:
        return {}, []
    table, rows = source.drawn(settings.HELD_ROWS, 0)[0].numbers(list(found.values()))
    values = {}
    notes = []
    for name, stood in zip(found, table.T, strict=True):
        turns = name not in prismatic
        if not np.isfinite(stood).any():
            continue
        stood = np.deg2rad(stood) if turns and degrees else stood
        values[name] = float(np.nanmedian(stood))
        off = np.nan_to_num(np.abs(stood - values[name]))
        factor, unit = for_people("rad" if turns else "m")
        most = f"{factor * off.max():.3g} {unit}"
        words = f"{source.label}: {name} is locked but moved by up to {most}"
        if np.mean(off > settings.LOCKED[turns]) > settings.LOCKED_SHARE:
            raise LogError(
                f"{words} (row {rows[np.argmax(off)]})",
                hint="name it in `joints` too, without `planar` if its axis is not parallel to the "
                "others', or leave out the rows in which it moved",
                parameter="joints",
                value=name,
            )
        if off.max() > settings.STILL[turns]:
            notes.append(f"{words}; leave out those rows, or name it in `joints`")
    return values, notes


_STILL = 1e-9  # of a joint's largest move: less is no motion


def directions(q: Array) -> Array:
    """Sign of the last motion of each joint (n, dof), for joint values in the order of motion.

    1 or -1; 0 before a joint's first motion, where it is not known.
    """
    step = np.diff(q, axis=0, prepend=q[:1])
    least = _STILL * np.abs(step).max(axis=0, initial=0.0)
    sign = np.where(np.abs(step) > least, np.sign(step), 0.0)
    # a joint that rests keeps the side from which it came
    moved = np.where(sign != 0.0, np.arange(len(q))[:, None], 0)
    latest = np.maximum.accumulate(moved, axis=0)
    return np.take_along_axis(sign, latest, axis=0)


_SAME = 6  # decimals [rad or m] to which joints at one pose read the same


def pose_index(q: Array) -> Index:
    """Number of the pose of each row (n,), counted in the order in which joints (n, dof) show them.

    However often it is read, a pose is one measurement of the arm.
    """
    _, first, index = np.unique(
        q.round(_SAME), axis=0, return_index=True, return_inverse=True
    )
    order = np.empty(len(first), dtype=np.intp)
    order[np.argsort(first)] = np.arange(len(first))
    return order[index.ravel()]


def joints_at(when: Array, time: Array, q: Array) -> Array:
    """Interpolate joints q (m, joints), recorded at times (m,), to times `when` (n,) [s]."""
    return np.stack([np.interp(when, time, column) for column in q.T], axis=1)


def joint_speed(when: Array, time: Array, q: Array) -> Array:
    """Return the fastest joint's speed about each time (n,) [rad/s or m/s]; see `joints_at`."""
    low, high = (joints_at(when + shift, time, q) for shift in (-SETTLE, SETTLE))
    return np.asarray(np.abs(high - low).max(axis=1) / (2.0 * SETTLE))


def check_limits(max_gap: float, still: float | None) -> None:
    """Refuse limits of `covered` and of the joints' speed that leave nothing."""
    for name, value in {"max_gap": max_gap, "still": still}.items():
        if value is not None and not value > 0:
            raise OptionError(f"`{name}={value:g}`: expected more than zero")


def covered(when: Array, time: Array, max_gap: float) -> dict[str, Mask]:
    """Tell which times (n,) lie between no joints that are close enough to interpolate, and why.

    Joints have times (m,), and are close at most `max_gap` [s] apart.
    """
    after = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    outside = (when < time[0]) | (when > time[-1])
    far = ~outside & (time[after] - time[after - 1] > max_gap)
    return {
        "outside of the joints' times": outside,
        f"joints more than {max_gap:g} s apart": far,
    }
