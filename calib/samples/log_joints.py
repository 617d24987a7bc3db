"""Joints of a log: their range, one turn at most, and where those stood that are not learned."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arm.ranges import Range
from ..common.arrays import Array, Index
from ..common.checks import LARGEST
from ..common.scale import TURN
from ..errors import CalibError, LogError, OptionError
from .joint_values import SLACK, beyond, in_words, many_turns, outside
from .settings import HELD_ROWS, LARGE_GAP, LOCKED, LOCKED_SHARE, ROUNDED, SMALL_GAP, STILL
from .tables import Source, open_source, read_columns


@dataclass(frozen=True)
class LoggedJoint:
    """One joint of a log, and what is known of its range."""

    label: str  # what messages call the log
    name: str
    revolute: bool
    limits: Range | None  # the arm's, or what the user asked for [rad or m]
    degrees: bool = False  # whether the log and the messages are in degrees

    def settle(self, values: Array, rows: Index) -> tuple[Array, Range, list[str]]:
        """Return values (n,) [rad or m], wrapped where needed, the joint's range, and notes.

        rows : (n,), their numbers in the file
        """
        low, high = float(values.min()), float(values.max())
        if self.limits is None and not self.revolute:
            return values, (low, high), []
        if self.limits is None or (self.revolute and np.diff(self.limits)[0] >= TURN - 1e-9):
            return self._round(values, rows, low, high)
        limits = lower, upper = self.limits
        moved = wrap(values, lower, upper) if self.revolute else values
        if not beyond(values, lower, upper) > SLACK >= beyond(moved, lower, upper):
            moved = values
        excess = beyond(moved, lower, upper)
        if excess > SLACK:
            hint = (
                "check that the column is of this joint, its unit and its sign; if the joint "
                f"really goes there, give `ranges={{{self.name!r}: (LOW, HIGH)}}`"
            )
            raise self._outside(values, rows, limits, hint)
        notes = self._wrapped(values, moved)
        widened = min(lower, float(moved.min())), max(upper, float(moved.max()))
        if excess > ROUNDED:
            was, now = (in_words(each, self.revolute, self.degrees) for each in (limits, widened))
            notes += [f"{self.name}: the log goes beyond the limits {was}; range widened to {now}"]
        return moved, widened, notes

    def _round(
        self, values: Array, rows: Index, low: float, high: float
    ) -> tuple[Array, Range, list[str]]:
        """Settle a joint that may turn all the way round."""
        if self.limits and self.limits[0] - 1e-9 <= low and high <= self.limits[1] + 1e-9:
            return np.clip(values, *self.limits), self.limits, []
        if many_turns(values):
            turn = "(-180, 180)" if self.degrees else "(-3.14159, 3.14159)"
            hint = f"to wrap it into one turn, give `ranges={{{self.name!r}: {turn}}}`"
            raise self._outside(values, rows, (-math.pi, math.pi), hint)
        wrapped, turn_of_it, gap = one_turn(values)
        if self.limits is None:
            # nearly a turn with a large gap: the joint works across the seam of its angles
            if high - low <= (TURN if gap < LARGE_GAP else TURN - 0.2):
                return values, (low, high), []
            if gap >= SMALL_GAP:
                turn_of_it = float(wrapped.min()), float(wrapped.max())
        return wrapped, turn_of_it, self._wrapped(values, wrapped)

    def _outside(self, values: Array, rows: Index, limits: Range, hint: str) -> CalibError:
        return outside(
            self.label, self.name, values, rows, limits,
            revolute=self.revolute, degrees=self.degrees, hint=hint,
        )  # fmt: skip

    def _wrapped(self, values: Array, wrapped: Array) -> list[str]:
        moved = int(np.count_nonzero(np.abs(wrapped - values) > 1.0))
        return [f"{self.name}: {moved} values wrapped by whole turns"] if moved else []


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
    if gap >= SMALL_GAP:
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
    found = [name for name in names if name in called or name in source]
    source, _ = source.drawn(HELD_ROWS, 0) if found else (source, 0)
    values, notes = {}, []
    for name in found:
        stood, turns = read_columns(source, [called.get(name, name)])[:, 0], name not in prismatic
        if not np.isfinite(stood).any():
            continue
        stood = np.deg2rad(stood) if turns and degrees else stood
        values[name] = float(np.nanmedian(stood))
        off = np.nan_to_num(np.abs(stood - values[name]))
        shown = f"{math.degrees(off.max()):.3g} deg" if turns else f"{1e3 * off.max():.3g} mm"
        words = f"{source.label}: {name} is locked but moved by up to {shown}"
        if np.mean(off > LOCKED[turns]) > LOCKED_SHARE:
            raise LogError(
                f"{words} (row {np.argmax(off) + 1})",
                hint="name it in `joints` too, without `planar` if its axis is not parallel to the "
                "others', or leave out the rows in which it moved",
                parameter="joints",
                value=name,
            )
        if off.max() > STILL[turns]:
            notes.append(f"{words}; leave out those rows, or name it in `joints`")
    return values, notes
