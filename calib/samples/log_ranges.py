"""The range of each joint of a log: the arm's limits or the data's, one turn at most."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.scale import TURN
from ..common.wording import unit_of_joint
from ..errors import LogError, OptionError
from .joint_values import beyond, in_degrees, many_turns

Range = tuple[float, float]

_SLACK = 0.05  # share of a range by which a log may leave it: limits are rounded, arms differ
_ROUNDED = 1e-4  # share of a range that is not worth a word
_SMALL_GAP = 0.1  # [rad]; data without a larger gap fill the circle
_LARGE_GAP = 0.5  # [rad]; a gap that shows where the joint cannot go


@dataclass(frozen=True)
class JointColumn:
    """The values of one joint in a log, and what is known about it."""

    # what messages call the log, and the joint's name
    label: str
    joint: str
    values: Array  # (n,) [rad or m], what was recorded
    revolute: bool
    # [rad or m], the arm's range of this joint, where there is an arm; the range that the user
    # asked for, which goes before it: all values lie in it, see `ChosenRange`
    limits: Range | None = None
    chosen: Range | None = None
    degrees: bool = False  # whether the log and the messages are in degrees
    # (n,), numbers of the rows in the file, where some were left out
    rows: NDArray[np.intp] | None = None

    def settle(self) -> tuple[Array, Range, list[str]]:
        """Return the values, wrapped where needed, the joint's range, and notes."""
        if self.chosen is not None:
            return self._within_chosen(self.chosen)
        if self.limits is None:
            return self._within_data()
        if self.revolute and self.limits[1] - self.limits[0] >= TURN - 1e-9:
            return self._within_turn(self.limits)
        return self._within_limits(self.limits)

    @property
    def _extremes(self) -> Range:
        return float(self.values.min()), float(self.values.max())

    def _within_chosen(self, chosen: Range) -> tuple[Array, Range, list[str]]:
        low, high = chosen
        values = wrap(self.values, low, high) if self.revolute else self.values
        return np.clip(values, low, high), (low, high), self._wrapped_note(values, chosen)

    def _within_data(self) -> tuple[Array, Range, list[str]]:
        low, high = self._extremes
        if self.revolute:
            self._refuse_many_turns()
        if not self.revolute or high - low < TURN - 0.2:
            return self.values, (low, high), []
        values, turn, gap = one_turn(self.values)
        if high - low <= TURN and gap < _LARGE_GAP:
            return self.values, (low, high), []
        if gap >= _SMALL_GAP:
            turn = float(values.min()), float(values.max())
        return values, turn, self._wrapped_note(values, turn)

    def _within_turn(self, limits: Range) -> tuple[Array, Range, list[str]]:
        low, high = self._extremes
        if limits[0] - 1e-9 <= low and high <= limits[1] + 1e-9:
            return np.clip(self.values, *limits), limits, []
        self._refuse_many_turns()
        if high - low < TURN - 1e-9:
            middle = (low + high) / 2.0
            turn = middle - math.pi, middle + math.pi
            return self.values, turn, [f"{self.joint}: range {self._show(turn)}, as in the log"]
        values, turn, _ = one_turn(self.values)
        return values, turn, self._wrapped_note(values, turn)

    def _within_limits(self, limits: Range) -> tuple[Array, Range, list[str]]:
        values, notes = self.values, []
        if self.revolute and np.ptp(values) <= TURN + 1e-9 and beyond(values, *limits) > _SLACK:
            wrapped = wrap(values, *limits)
            if beyond(wrapped, *limits) <= _SLACK:
                notes += self._wrapped_note(wrapped, limits)
                values = wrapped
        excess = beyond(values, *limits)
        if excess > _SLACK:
            raise self._outside(limits)
        low, high = min(limits[0], float(values.min())), max(limits[1], float(values.max()))
        if excess > _ROUNDED:
            notes.append(
                f"{self.joint}: the log goes beyond the limits {self._show(limits)}; "
                f"range widened to {self._show((low, high))}"
            )
        return values, (low, high), notes

    def _outside(self, limits: Range) -> LogError:
        row = int(np.argmax(np.maximum(limits[0] - self.values, self.values - limits[1])))
        number = row + 1 if self.rows is None else self.rows[row]
        factor, unit = unit_of_joint(self.revolute, self.degrees)
        message = (
            f"{self.label}, row {number}: {self.joint} is {factor * self.values[row]:g} {unit}, "
            f"outside of its limits {self._show(limits)}"
        )
        # small angles of another column look like degrees too
        far = float(np.abs(self.values).max()) > TURN
        if self.revolute and not self.degrees and far and in_degrees(self.values, *limits):
            hint = "as degrees the log fits: give `degrees=True`"
            return LogError(message, hint=hint, parameter="degrees", value=self.degrees)
        hint = f"if the joint really goes there, give `ranges={{{self.joint!r}: (LOW, HIGH)}}`"
        if beyond(-self.values, *limits) <= _SLACK:
            hint = "with the opposite sign it fits: change the sign of its column"
        else:
            hint = f"check that the column is of this joint and in its unit; {hint}"
        return LogError(message, hint=hint, parameter="ranges", value=float(self.values[row]))

    def _refuse_many_turns(self) -> None:
        if not many_turns(self.values):
            return
        low, high = self._extremes
        turns = (high - low) / TURN
        turn = "(-180, 180)" if self.degrees else "(-3.14159, 3.14159)"
        remedy = "" if self.degrees else "if the log is in degrees, give `degrees=True`; "
        raise LogError(
            f"{self.label}: {self.joint} goes {self._show((low, high))}, {turns:.1f} turns",
            hint=f"{remedy}to wrap it into one turn, give `ranges={{{self.joint!r}: {turn}}}`",
            parameter="ranges" if self.degrees else "degrees",
            value=(low, high),
        )

    def _wrapped_note(self, values: Array, turn: Range) -> list[str]:
        moved = int(np.count_nonzero(np.abs(values - self.values) > 1.0))
        if not moved:
            return []
        return [f"{self.joint}: {moved} values wrapped by whole turns into {self._show(turn)}"]

    def _show(self, limits: Range) -> str:
        return _shown(limits, self.revolute, self.degrees)


@dataclass
class ChosenRange:
    """A joint's range that the user chose, and how many values of a log were `outside` so far.

    See `JointColumn` for the attributes that both have.
    """

    label: str
    joint: str
    limits: Range
    revolute: bool
    degrees: bool = False
    outside: int = 0

    def __post_init__(self) -> None:
        self.limits = _checked(self.joint, self.limits, self.revolute)
        self._inside = False
        self._extremes = math.inf, -math.inf

    def holds(self, values: Array) -> NDArray[np.bool_]:
        """Whether each value (n,) lies in the range, once wrapped, (n,)."""
        low, high = self.limits
        wrapped = wrap(values, low, high) if self.revolute else values
        edge = _ROUNDED * (high - low)
        away = (wrapped < low - edge) | (wrapped > high + edge)
        self.outside += int(np.count_nonzero(away))
        self._inside |= not away.all()
        least, most = self._extremes
        self._extremes = float(values.min(initial=least)), float(values.max(initial=most))
        return np.asarray(~away)

    def notes(self) -> list[str]:
        """Say how many rows were left out; it is an error if all were."""
        shown = _shown(self.limits, self.revolute, self.degrees)
        if not self._inside:
            raise LogError(
                f"{self.label}: no value of {self.joint!r} lies in the range {shown}; the log "
                f"has {_shown(self._extremes, self.revolute, self.degrees)}"
            )
        if not self.outside:
            return []
        return [f"{self.outside} rows dropped: {self.joint} outside of the range {shown}"]


def one_turn(angles: Array) -> tuple[Array, Range, float]:
    """Wrap angles into one turn that is cut where they leave the largest gap.

    angles : (n,) [rad], any number of turns
    Returns wrapped : (n,) [rad], the angles; those that lay in the turn already are left as they
        were
    Returns turn : [rad], the turn, centred on the angles, or on 0 where they fill the whole circle
    Returns gap : [rad], the largest gap

    Examples
    --------
    >>> wrapped, turn, gap = one_turn(np.array([3.0, -3.0, 2.0, -2.0]))
    >>> wrapped.round(2).tolist(), (sum(turn) / 2 / np.pi).__round__(6)
    ([3.0, 3.28, 2.0, 4.28], 1.0)
    """
    circle = np.sort(np.mod(angles, TURN))
    gaps = np.diff(circle, append=circle[0] + TURN)
    widest = int(np.argmax(gaps))
    gap = float(gaps[widest])
    centre = 0.0
    if gap >= _SMALL_GAP:
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


def _shown(limits: Range, revolute: bool, degrees: bool) -> str:
    factor, unit = unit_of_joint(revolute, degrees)
    return f"{factor * limits[0]:.4g}..{factor * limits[1]:.4g} {unit}"


def _checked(joint: str, chosen: Range, revolute: bool) -> Range:
    low, high = (float(value) for value in chosen)
    wrong, hint = "", None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        wrong = ": expected low:high with low below high"
    elif revolute and high - low > TURN + 1e-4:
        wrong, hint = " is more than one turn", "if these are degrees, give `degrees=True`"
    if wrong:
        message = f"range {joint}={low:g}:{high:g}{wrong}"
        raise OptionError(message, hint=hint, parameter="ranges", value=(low, high))
    return low, high
