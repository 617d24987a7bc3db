"""Joint values: a plausible range and unit, the direction of approach, values between two times.

Use it on a table of queries, a trajectory to correct or a log: one check for all of them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arm.ranges import Range
from ..common.arrays import Array, Index, Mask
from ..common.checks import LARGEST
from ..common.scale import TURN
from ..common.wording import unit_of_joint
from ..errors import CalibError, LogError, OptionError
from . import settings
from .tables import Source, open_source

MAX_GAP = 0.1
"""Joints further apart than this are not interpolated between [s]."""

SETTLE = 0.04
"""Time before and after, over which a joint's speed is taken: encoders count in steps [s]."""

_MOST_TURNS = 4.0  # further from zero a joint value is in degrees, or not reset for long


def beyond(values: Array, low: float, high: float) -> float:
    """Return by how much values (n,) leave a range, as a share of its width."""
    return max(low - float(values.min()), float(values.max()) - high, 0.0) / (high - low)


def fits_in_degrees(values: Array, low: float, high: float) -> bool:
    """Whether angles (n,) [rad] of more than a turn leave a range, and not if they are degrees.

    Small angles of another column look like degrees too.
    """
    outside = beyond(values, low, high) > settings.SLACK and float(np.abs(values).max()) > TURN
    return outside and beyond(np.deg2rad(values), low, high) <= settings.SLACK


def many_turns(values: Array) -> bool:
    """Whether angles (n,) [rad] go further round than a joint does: degrees, most likely."""
    low, high = float(values.min()), float(values.max())
    return high - low > 2.02 * TURN or max(abs(low), abs(high)) > _MOST_TURNS * TURN


@dataclass(frozen=True)
class LoggedJoint:
    """One joint of a log or a table, and what is known of its range."""

    label: str  # what messages call the table
    name: str
    revolute: bool
    limits: Range | None  # the arm's, or what the user asked for [rad or m]
    degrees: bool = False  # whether the table and the messages are in degrees
    error: type[CalibError] = LogError

    def show(self, *limits: float) -> str:
        """Return values [rad or m] in the unit of the table."""
        factor, unit = unit_of_joint(self.revolute, self.degrees)
        return f"{'..'.join(f'{factor * value:.6g}' for value in limits)} {unit}"

    def outside(self, values: Array, rows: Index, limits: Range, hint: str = "") -> CalibError:
        """Return the error for the value (n,) furthest outside of a range, with the remedy."""
        low, high = limits
        row = int(np.argmax(np.maximum(low - values, values - high)))
        rounds = self.revolute and many_turns(values)
        fits = self.revolute and not self.degrees and fits_in_degrees(values, low, high)
        turned = rounds or fits
        if fits:
            hint = "as degrees it fits: give `degrees=True`"
        elif rounds and not self.degrees:
            hint = f"if the values are in degrees, give `degrees=True`; {hint}"
        elif rounds:
            hint = f"values in rad are given without `degrees`; {hint}"
        words = f"{self.name} is {self.show(values[row])}, outside of the range"
        return self.error(
            f"{self.label}, row {rows[row]}: {words} {self.show(low, high)}",
            hint=hint.removesuffix("; ") or None,
            parameter="degrees" if turned else "ranges",
            value=self.degrees if turned else float(values[row]),
        )

    def settle(self, values: Array, rows: Index) -> tuple[Array, Range, list[str]]:
        """Return values (n,) [rad or m], wrapped where needed, the joint's range, and notes.

        rows : (n,), their numbers in the file
        """
        low, high = float(values.min()), float(values.max())
        if self.limits is None and not self.revolute:
            return values, (low, high), []
        if self.limits is None or (self.revolute and np.diff(self.limits)[0] >= TURN - 1e-9):
            moved, limits = self._round(values, rows, low, high)
            return moved, limits, self._wrapped(values, moved)
        limits = lower, upper = self.limits
        moved = wrap(values, lower, upper) if self.revolute else values
        if not beyond(values, lower, upper) > settings.SLACK >= beyond(moved, lower, upper):
            moved = values
        excess, notes = beyond(moved, lower, upper), self._wrapped(values, moved)
        if excess > settings.SLACK:
            hint = "check that the column is of this joint, its unit and its sign; if the joint "
            hint += f"really goes there, give `ranges={{{self.name!r}: (LOW, HIGH)}}`"
            raise self.outside(values, rows, limits, hint)
        widened = min(lower, float(moved.min())), max(upper, float(moved.max()))
        if excess > settings.ROUNDED:
            was = f"{self.name}: the log goes beyond the limits {self.show(*limits)}"
            notes.append(f"{was}; range widened to {self.show(*widened)}")
        return moved, widened, notes

    def _round(self, values: Array, rows: Index, low: float, high: float) -> tuple[Array, Range]:
        """Values and the range of a joint that may turn all the way round."""
        if self.limits and self.limits[0] - 1e-9 <= low and high <= self.limits[1] + 1e-9:
            return np.clip(values, *self.limits), self.limits
        if many_turns(values):
            turn = "(-180, 180)" if self.degrees else "(-3.14159, 3.14159)"
            hint = f"to wrap it into one turn, give `ranges={{{self.name!r}: {turn}}}`"
            raise self.outside(values, rows, (-math.pi, math.pi), hint)
        if self.limits and high - low < TURN - 1e-9:  # the log's own turn, whatever its gaps
            return values, ((low + high) / 2.0 - math.pi, (low + high) / 2.0 + math.pi)
        wrapped, turn_of_it, gap = one_turn(values)
        if self.limits is None:
            # nearly a turn with a large gap: the joint works across the seam of its angles
            if high - low <= (TURN if gap < settings.LARGE_GAP else TURN - 0.2):
                return values, (low, high)
            if gap >= settings.SMALL_GAP:
                turn_of_it = float(wrapped.min()), float(wrapped.max())
        return wrapped, turn_of_it

    def _wrapped(self, values: Array, wrapped: Array) -> list[str]:
        moved = int(np.count_nonzero(np.abs(wrapped - values) > 1.0))
        return [f"{self.name}: {moved} values wrapped by whole turns"] if moved else []


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
        values, limits = q[rows, k], (float(lower[k]), float(upper[k]))
        if many_turns(values) or (not degrees and fits_in_degrees(values, *limits)):
            joint = LoggedJoint(label, names[k], True, limits, degrees, error)
            raise joint.outside(values, rows + 1, limits)


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
    return {"outside of the joints' times": outside, f"joints more than {max_gap:g} s apart": far}


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


def one_turn(angles: Array) -> tuple[Array, Range, float]:
    """Wrap angles into one turn that is cut where they leave the largest gap.

    Returns the angles (n,) [rad], the turn, centred on them or on 0 where they fill the circle, and
    the largest gap [rad].

    Examples
    --------
    >>> one_turn(np.array([3.0, -3.0, 2.0, -2.0]))[0].round(2).tolist()
    [3.0, 3.28, 2.0, 4.28]
    """
    circle = np.sort(np.mod(angles, TURN))
    gaps = np.diff(circle, append=circle[0] + TURN)
    widest = int(np.argmax(gaps))
    gap = float(gaps[widest])
    centre = 0.0
    if gap >= settings.SMALL_GAP:
        centre = math.remainder(circle[widest] + gap / 2.0 + math.pi, TURN)
        centre = math.pi if centre <= -math.pi + 1e-9 else centre
    low, high = centre - math.pi, centre + math.pi
    return wrap(angles, low, high), (low, high), gap


def wrap(values: Array, low: float, high: float) -> Array:
    """Move the angles (n,) outside of a range by whole turns to where they are nearest to it."""
    moved = low + np.mod(values - low, TURN)
    # An angle just below the range is nearer to it than a turn later.
    moved = np.where(moved - high > TURN / 2.0 - (high - low) / 2.0, moved - TURN, moved)
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
    source, called = open_source(path), columns or {}
    found = [name for name in names if name in called or name in source.header]
    source, _ = source.drawn(settings.HELD_ROWS, 0) if found else (source, 0)
    values, notes = {}, []
    for name in found:
        (stood,), rows = (each.T for each in source.numbers([called.get(name, name)]))
        turns = name not in prismatic
        if not np.isfinite(stood).any():
            continue
        stood = np.deg2rad(stood) if turns and degrees else stood
        values[name] = float(np.nanmedian(stood))
        off = np.nan_to_num(np.abs(stood - values[name]))
        shown = f"{math.degrees(off.max()):.3g} deg" if turns else f"{1e3 * off.max():.3g} mm"
        words = f"{source.label}: {name} is locked but moved by up to {shown}"
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
