"""The range of each joint of a log: the arm's limits or the data's, one turn at most."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arm.ranges import Range
from ..common.arrays import Array, Mask
from ..common.scale import TURN
from ..common.wording import unit_of_joint
from ..errors import LogError, OptionError
from .joint_values import SLACK, beyond, in_degrees, many_turns

UNKNOWN_RANGE: Range = (-math.inf, math.inf)

_ROUNDED = 1e-4  # share of a range that is not worth a word
_SMALL_GAP = 0.1  # [rad]; data without a larger gap fill the circle
_LARGE_GAP = 0.5  # [rad]; a gap that shows where the joint cannot go


@dataclass(frozen=True)
class LoggedJoint:
    """One joint of a log, and what is known of its range."""

    label: str  # what messages call the log
    name: str
    revolute: bool
    limits: Range = UNKNOWN_RANGE  # the arm's range of this joint, where there is an arm [rad or m]
    degrees: bool = False  # whether the log and the messages are in degrees
    chosen: bool = False  # whether the user asked for `limits`: other rows are left out

    def with_range(self, asked: Range) -> LoggedJoint:
        """Return the joint with the range that the user asks for.

        Raises OptionError if it is no range.
        """
        low, high = (float(value) for value in asked)
        wrong, hint = "", None
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            wrong = ": expected low:high with low below high"
        elif self.revolute and high - low > TURN + 1e-4:
            wrong, hint = " is more than one turn", "if these are degrees, give `degrees=True`"
        if wrong:
            message = f"range {self.name}={low:g}:{high:g}{wrong}"
            raise OptionError(message, hint=hint, parameter="ranges", value=(low, high))
        return replace(self, limits=(low, high), chosen=True)

    def holds(self, values: Array) -> Mask:
        """Whether each value (n,) lies in the chosen range, once wrapped, (n,)."""
        low, high = self.limits
        wrapped = self._wrapped(values)
        edge = _ROUNDED * (high - low)
        return np.asarray((wrapped >= low - edge) & (wrapped <= high + edge))

    def settle(self, values: Array, rows: NDArray[np.intp]) -> tuple[Array, Range, list[str]]:
        """Return values (n,) [rad or m], wrapped where needed, the joint's range, and notes.

        rows : (n,), their numbers in the file
        """
        limits, (low, high) = self.limits, _extremes(values)
        unknown = limits == UNKNOWN_RANGE
        if self.chosen:
            wrapped = self._wrapped(values)
            return np.clip(wrapped, *limits), limits, self._moved(values, wrapped, limits)
        if not unknown and not (self.revolute and limits[1] - limits[0] >= TURN - 1e-9):
            return self._within_limits(values, rows)
        if not unknown and limits[0] - 1e-9 <= low and high <= limits[1] + 1e-9:
            return np.clip(values, *limits), limits, []
        if self.revolute and many_turns(values):
            turn = "(-180, 180)" if self.degrees else "(-3.14159, 3.14159)"
            remedy = "" if self.degrees else "if the log is in degrees, give `degrees=True`; "
            raise LogError(
                f"{self.label}: {self.name} goes {self.show((low, high))}, "
                f"{(high - low) / TURN:.1f} turns",
                hint=f"{remedy}to wrap it into one turn, give `ranges={{{self.name!r}: {turn}}}`",
                parameter="ranges" if self.degrees else "degrees",
                value=(low, high),
            )
        if not unknown and high - low < TURN - 1e-9:
            middle = (low + high) / 2.0
            round_it = middle - math.pi, middle + math.pi
            return values, round_it, [f"{self.name}: range {self.show(round_it)}, as in the log"]
        wrapped, whole, gap = one_turn(values)
        short = high - low < TURN - 0.2 or (high - low <= TURN and gap < _LARGE_GAP)
        if unknown and (short or not self.revolute):
            return values, (low, high), []
        if unknown and gap >= _SMALL_GAP:
            whole = _extremes(wrapped)
        return wrapped, whole, self._moved(values, wrapped, whole)

    def show(self, limits: Range) -> str:
        """Return a range in the unit of the log."""
        factor, unit = unit_of_joint(self.revolute, self.degrees)
        return f"{factor * limits[0]:.4g}..{factor * limits[1]:.4g} {unit}"

    def _wrapped(self, values: Array) -> Array:
        return wrap(values, *self.limits) if self.revolute else values

    def _within_limits(
        self, values: Array, rows: NDArray[np.intp]
    ) -> tuple[Array, Range, list[str]]:
        limits, notes = self.limits, []
        low, high = limits
        if self.revolute and np.ptp(values) <= TURN + 1e-9 and beyond(values, *limits) > SLACK:
            wrapped = self._wrapped(values)
            if beyond(wrapped, *limits) <= SLACK:
                notes, values = self._moved(values, wrapped, limits), wrapped
        excess = beyond(values, *limits)
        if excess > SLACK:
            row = int(np.argmax(np.maximum(low - values, values - high)))
            factor, unit = unit_of_joint(self.revolute, self.degrees)
            # small angles of another column look like degrees too
            far = self.revolute and not self.degrees and float(np.abs(values).max()) > TURN
            in_other = far and in_degrees(values, low, high)
            hint = (
                "check that the column is of this joint and in its unit; if the joint really goes "
                f"there, give `ranges={{{self.name!r}: (LOW, HIGH)}}`"
            )
            if in_other:
                hint = "as degrees the log fits: give `degrees=True`"
            elif beyond(-values, low, high) <= SLACK:
                hint = "with the opposite sign it fits: change the sign of its column"
            raise LogError(
                f"{self.label}, row {rows[row]}: {self.name} is {factor * values[row]:g} {unit}, "
                f"outside of its limits {self.show(limits)}",
                hint=hint,
                parameter="degrees" if in_other else "ranges",
                value=self.degrees if in_other else float(values[row]),
            )
        widened = min(low, float(values.min())), max(high, float(values.max()))
        if excess > _ROUNDED:
            notes.append(
                f"{self.name}: the log goes beyond the limits {self.show(limits)}; "
                f"range widened to {self.show(widened)}"
            )
        return values, widened, notes

    def _moved(self, values: Array, wrapped: Array, turn: Range) -> list[str]:
        moved = int(np.count_nonzero(np.abs(wrapped - values) > 1.0))
        told = f"{self.name}: {moved} values wrapped by whole turns into {self.show(turn)}"
        return [told] if moved else []


def _extremes(values: Array) -> Range:
    return float(values.min()), float(values.max())


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
