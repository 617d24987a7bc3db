"""Joint values: a plausible range and unit, the direction of approach, values between two times.

Use it on a table of queries, a trajectory to correct or a log: one check for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.scale import TURN
from ..common.wording import unit_of_joint
from ..errors import CalibError, LogError, OptionError

MAX_GAP = 0.1
"""Joints further apart than this are not interpolated between [s]."""

SETTLE = 0.04
"""Time before and after, over which a joint's speed is taken: encoders count in steps [s]."""

SLACK = 0.05
"""Share of a range by which values may leave it: limits are rounded, and arms differ."""

_MOST_TURNS = 4.0  # further from zero a joint value is in degrees, or not reset for long


def beyond(values: Array, low: float, high: float) -> float:
    """Return by how much values (n,) leave a range, as a share of its width."""
    return max(low - float(values.min()), float(values.max()) - high, 0.0) / (high - low)


def fits_in_degrees(values: Array, low: float, high: float) -> bool:
    """Whether angles (n,) [rad] of more than a turn leave a range, and not if they are degrees.

    Small angles of another column look like degrees too.
    """
    outside = beyond(values, low, high) > SLACK and float(np.abs(values).max()) > TURN
    return outside and beyond(np.deg2rad(values), low, high) <= SLACK


def many_turns(values: Array) -> bool:
    """Whether angles (n,) [rad] go further round than a joint does: degrees, most likely."""
    low, high = float(values.min()), float(values.max())
    return high - low > 2.02 * TURN or max(abs(low), abs(high)) > _MOST_TURNS * TURN


def in_words(limits: tuple[float, float], revolute: bool, degrees: bool) -> str:
    """Return a joint's range [rad or m] in the unit that it was given in."""
    factor, unit = unit_of_joint(revolute, degrees)
    return f"{factor * limits[0]:.4g}..{factor * limits[1]:.4g} {unit}"


def outside(
    label: str,
    name: str,
    values: Array,
    rows: Index,
    limits: tuple[float, float],
    *,
    revolute: bool = True,
    degrees: bool = False,
    hint: str = "",
    error: type[CalibError] = LogError,
) -> CalibError:
    """Return the error for the value (n,) that is furthest outside of a range, with the remedy."""
    low, high = limits
    row = int(np.argmax(np.maximum(low - values, values - high)))
    factor, unit = unit_of_joint(revolute, degrees)
    rounds = revolute and many_turns(values)
    turned = revolute and not degrees and (rounds or fits_in_degrees(values, low, high))
    if turned or rounds:
        other = "values in rad are given without `degrees`"
        other = "if the values are in degrees, give `degrees=True`" if turned else other
        hint = f"{other}; {hint}".removesuffix("; ")
    return error(
        f"{label}, row {rows[row]}: {name} is {values[row] * factor:g} {unit}, outside of the "
        f"range {in_words(limits, revolute, degrees)}",
        hint=hint or None,
        parameter="degrees" if turned else "ranges",
        value=degrees if turned else float(values[row]),
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
        values, limits = q[rows, k], (float(lower[k]), float(upper[k]))
        if many_turns(values) or fits_in_degrees(values, *limits):
            raise outside(label, names[k], values, rows + 1, limits, degrees=degrees, error=error)


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
    if not max_gap > 0:
        raise OptionError(f"`max_gap={max_gap:g}`: expected more than zero [s]")
    if still is not None and not still > 0:
        raise OptionError(f"`still={still:g}`: expected a speed above zero [rad/s or m/s]")


def covered(when: Array, time: Array, max_gap: float) -> dict[str, Mask]:
    """Tell which times (n,) lie between no joints that are close enough to interpolate, and why.

    Joints have times (m,), and are close at most `max_gap` [s] apart.
    """
    after = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    outside = (when < time[0]) | (when > time[-1])
    far = ~outside & (time[after] - time[after - 1] > max_gap)
    return {"outside of the joints' times": outside, f"joints more than {max_gap:g} s apart": far}
