"""Joint values: a plausible unit and range.

Use it on a table of queries, a trajectory to correct or a log: one check for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import Arm
from ..common.arrays import Array, Index, Range
from ..common.inputs import LARGEST
from ..common.rows import finite_rows
from ..common.scale import TURN
from ..common.wording import listing, unit_of_joint
from ..errors import CalibError, LogError, OptionError
from .column_units import LENGTHS, RADIANS, joint_factor, name_and_unit
from .settings import READING

_FULL_TURN = (-math.pi, math.pi)


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
    """Refuse joint values that can only be of another unit than declared.

    Values a little outside of the range pass: their user decides what becomes of them.

    q : (n, dof) [rad or m], joint values; rows that are not finite are passed over
    lower, upper : (dof,) [rad or m], the joints' learned range
    degrees : whether the values were given in degrees, and converted
    """
    rows = np.flatnonzero(finite_rows(q))
    factor = RADIANS["deg"] if degrees else 1.0
    for k in np.flatnonzero(revolute).tolist():
        limits = (float(lower[k]), float(upper[k]))
        joint = JointColumn(label, names[k], True, limits, factor, error)
        if len(rows):
            joint.check_unit(q[rows, k], rows + 1)


@dataclass(frozen=True)
class JointColumn:
    """The column of a joint in a log or a table, and what is known of its range."""

    label: str  # what messages call the table
    name: str
    revolute: bool
    limits: Range | None  # the arm's, or the user's choice [rad or m]
    factor: float = 1.0  # rad or m of the column's unit
    error: type[CalibError] = LogError

    @property
    def degrees(self) -> bool:
        """Whether the table and the messages are in degrees."""
        return self.revolute and self.factor != 1.0

    def check_unit(self, values: Array, rows: Index) -> None:
        """Refuse angles (n,) [rad] of another unit: too many turns, or in range as the other."""
        limits = self.limits or _FULL_TURN
        most = float(np.abs(values).max())
        too_many = READING.most_turns * TURN
        other = np.rad2deg(values) if self.degrees else np.deg2rad(values)
        # small angles in rad look like degrees, too: they are none
        is_small = not self.degrees and most <= TURN
        is_outside = beyond(values, *limits) > READING.slack
        fits_other = is_outside and beyond(other, *limits) <= READING.slack
        # within less than a turn few angles but wrapped ones are in range a turn away
        wrapped = wrap(values, *limits)
        is_wrapped = (
            limits[1] - limits[0] < 0.75 * TURN
            and np.abs(wrapped - values).max() < 1.5 * TURN
            and beyond(wrapped, *limits) <= READING.slack
        )
        fits = self.limits is not None and not is_small and fits_other
        fits = fits and not is_wrapped
        if not (fits or np.ptp(values) > 2.02 * TURN or most > too_many):
            return
        if (most if self.degrees else math.radians(most)) > too_many:
            hint = (
                "too much for degrees, too: convert an encoder's counts to rad"
            )
        elif self.degrees:
            hint = "it is in rad: leave out `degrees`"
        elif fits:
            hint = "as degrees it fits: give `degrees=True`"
        else:
            hint = "if it is in degrees, give `degrees=True`"
            if not self.limits:
                hint += "; if it slides, name it in `prismatic`"
        raise self._outside(values, rows, limits, hint, "degrees")

    def into_range(
        self, values: Array, rows: Index
    ) -> tuple[Array, Range, list[str]]:
        """Return values (n,) [rad or m], wrapped where needed, the joint's range, and notes.

        rows : (n,), their numbers in the file
        """
        extremes = (float(values.min()), float(values.max()))
        limits = self.limits or (_FULL_TURN if self.revolute else extremes)
        excess = beyond(values, *limits)
        if self.revolute and excess > 0:
            self.check_unit(values, rows)
        is_turn = self.revolute and limits[1] - limits[0] >= TURN - 1e-9
        if is_turn and extremes[1] - extremes[0] <= TURN:
            clipped, turn = _within_own_turn(values, limits)
            return clipped, turn if self.limits else extremes, []
        wrapped = values
        if self.revolute and (is_turn or excess > READING.slack):
            wrapped = wrap(values, *limits)
        excess = beyond(wrapped, *limits)
        if excess > READING.slack:
            hint = (
                "check that the column is of this joint, its unit and its sign; if the joint "
                f"really goes there, give `ranges={{{self.name!r}: (LOW, HIGH)}}`"
            )
            raise self._outside(values, rows, limits, hint, "ranges")
        low = min(limits[0], float(wrapped.min()))
        high = max(limits[1], float(wrapped.max()))
        count = int(np.count_nonzero(np.abs(wrapped - values) > 1.0))
        return wrapped, (low, high), self._notes(count, excess, low, high)

    def _notes(
        self, wrapped: int, excess: float, low: float, high: float
    ) -> list[str]:
        """Return notes on the values that were wrapped, and on a range that the log widens.

        excess : by how much the log leaves the limits, see `beyond`
        """
        notes = []
        if wrapped:
            notes.append(
                f"{self.name}: {wrapped} values wrapped by whole turns"
            )
        if excess > READING.rounded:
            notes.append(
                f"{self.name}: the log goes beyond the limits; range {self._show(low, high)}"
            )
        return notes

    def _show(self, *values: float) -> str:
        """Values [rad or m] in the unit of the table."""
        factor, unit = unit_of_joint(self.revolute, self.degrees)
        numbers = "..".join(f"{factor * value:.6g}" for value in values)
        return f"{numbers} {unit}"

    def _outside(
        self,
        values: Array,
        rows: Index,
        limits: Range,
        hint: str,
        parameter: str,
    ) -> CalibError:
        """The error that names the value (n,) furthest outside of a range."""
        row = int(np.argmax(np.abs(values - sum(limits) / 2.0)))
        return self.error(
            f"{self.label}, row {rows[row]}: {self.name} is {self._show(values[row])}, "
            f"outside of the range {self._show(*limits)}",
            hint=hint,
            parameter=parameter,
            value=float(values[row]),
        )


def columns_of_joints(
    label: str,
    columns: Mapping[str, str],
    arm: Arm | None,
    ranges: Mapping[str, Range],
    prismatic: Sequence[str],
    *,
    degrees: bool,
) -> list[JointColumn]:
    """Return the columns of a log's joints, with the arm's limits, or the user's ranges.

    columns : of the joints; without an arm those in a unit of lengths slide, too
    """
    for option, names in {"prismatic": prismatic, "ranges": ranges}.items():
        if not {*names} <= {*columns}:
            raise OptionError(
                f"`{option}` of {listing(names)}: expected some of the joints {listing(columns)}",
                parameter=option,
            )
    joints = []
    for k, (name, column) in enumerate(columns.items()):
        if arm is None:
            in_lengths = name_and_unit(column)[1] in LENGTHS
            revolute = not (in_lengths or name in prismatic)
            limits = ranges.get(name)
        else:
            revolute = arm.revolute[k]
            limits = ranges.get(name, (arm.lower[k], arm.upper[k]))
        if name in ranges:
            _check_range(name, ranges[name], revolute)
        factor = joint_factor(column, revolute=revolute, degrees=degrees)
        joints.append(JointColumn(label, name, revolute, limits, factor))
    return joints


def into_ranges(
    joints: Sequence[JointColumn], q: Array, numbers: Index, *, anywhere: bool
) -> tuple[Array, Array, Array, list[str]]:
    """Return joint values (n, dof) in their ranges, the ranges' ends (dof,), and notes.

    numbers : (n,), of the rows in the file
    anywhere : whether a hand has moved the arm, so that limits are no mistake
    """
    in_range = np.empty_like(q)
    ends = []
    notes = []
    for k, joint in enumerate(joints):
        column = q[:, k]
        if joint.limits and anywhere:
            low, high = joint.limits
            limits = (min(low, column.min()), max(high, column.max()))
            joint = replace(joint, limits=limits)
        in_range[:, k], end, words = joint.into_range(column, numbers)
        ends.append(end)
        notes += words
    lower, upper = np.transpose(ends)
    return in_range, lower, upper, notes


def beyond(values: Array, low: float, high: float) -> float:
    """Return by how much values (n,) leave a range, as a share of its width."""
    excess = max(low - float(values.min()), float(values.max()) - high, 0.0)
    return excess / max(high - low, 1e-300)


def _within_own_turn(values: Array, limits: Range) -> tuple[Array, Range]:
    """Return angles (n,) [rad] that fit into a turn, clipped to one, and this turn.

    limits : the turn if no angle leaves it; else it is the log's own, whatever its gaps
    """
    if beyond(values, *limits) >= 1e-9:
        middle = float(values.min() + values.max()) / 2.0
        limits = (middle - math.pi, middle + math.pi)
    return np.clip(values, *limits), limits


def _check_range(name: str, limits: Range, revolute: bool) -> None:
    """Raise OptionError for a joint's range that is none, or more than a turn [rad or m]."""
    low, high = limits
    most = TURN + 1e-4 if revolute else LARGEST
    if not 0 < high - low <= most:
        raise OptionError(
            f"range {name}={low:g}:{high:g}: expected low:high with low below high, of a joint "
            "that turns one turn at most [rad]",
            parameter="ranges",
            value=limits,
        )


def wrap(values: Array, low: float, high: float) -> Array:
    """Move the angles (n,) outside of a range by whole turns to where they are nearest to it."""
    turns = np.round((values - (low + high) / 2.0) / TURN)
    moved = values - TURN * turns
    if high - low >= TURN - 1e-9:
        moved = np.clip(moved, low, high)
    return np.where((values < low) | (values > high), moved, values)
