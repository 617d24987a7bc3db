"""Ranges: the part of a joint's travel that is babbled and learned."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..common.scale import TURN
from ..errors import OptionError, RobotError
from .urdf import Joint

#: A sliding joint that claims to travel further than this [m] states no usable limit.
_MAX_TRAVEL = 1_000.0
#: Limits that exceed one turn or a range that exceeds its limits by less than this are
#: rounding (3.1416, 1.5708), and are clipped in silence.
_ROUNDING = 1e-3

Range = tuple[float, float]


def unit_of(joint: Joint) -> str:
    """Return the unit of a joint's value: rad or m."""
    return "rad" if joint.revolute else "m"


def limits_fault(joint: Joint) -> str | None:
    """Say why a joint's limits cannot bound its babbling, or None if they can."""
    if joint.kind == "continuous":
        return None
    if joint.limits is None:
        return "it states no limits"
    lower, upper = joint.limits
    if lower > upper:
        return f"its limits are inverted ({lower:g} > {upper:g})"
    if lower == upper:
        return f"its limits leave no room ({lower:g} to {upper:g})"
    if not joint.revolute and not upper - lower <= _MAX_TRAVEL:
        return f"its limits are unusable ({lower:g} to {upper:g} m)"
    return None


def fixed_by_limits(joint: Joint) -> bool:
    """Whether a joint's limits leave it no room at all."""
    return joint.limits is not None and joint.limits[0] == joint.limits[1]


def travel(joint: Joint) -> Range:
    """Range that a joint can mechanically reach, infinite where its limits do not say."""
    if joint.limits is None or limits_fault(joint):
        return -math.inf, math.inf
    return joint.limits


def neutral(joint: Joint) -> float:
    """Zero, clipped into the joint's limits where it has sensible ones."""
    lower, upper = travel(joint)
    if fixed_by_limits(joint) and joint.limits is not None:
        lower, upper = joint.limits
    return min(max(0.0, lower), upper)


def check_joint_limits(joints: Sequence[Joint]) -> None:
    """Ask for `ranges` of all joints whose limits are unusable."""
    faulty = [joint for joint in joints if limits_fault(joint)]
    if faulty:
        faults = "; ".join(
            f"joint {joint.name!r} cannot be babbled, {limits_fault(joint)}" for joint in faulty
        )
        raise RobotError(faults, hint=f"give {ranges_wanted(faulty)}", parameter="ranges")


def ranges_wanted(joints: Sequence[Joint]) -> str:
    """Return the parameter that would give these joints a range, to be filled in."""
    entries = ", ".join(f"{joint.name!r}: (LOWER, UPPER)" for joint in joints)
    units = sorted({unit_of(joint) for joint in joints})
    return f"`ranges={{{entries}}}` [{', '.join(units)}]"


def checked_range(name: str, chosen: Range, limits: Range, unit: str) -> Range:
    """Return a range that the user chose, clipped into the limits if only rounding is over.

    Raises OptionError if it is not finite, empty or inverted, or goes beyond the joint's limits.
    """
    lower, upper = (float(end) for end in chosen)
    shown = f"`ranges={{{name!r}: ({lower:g}, {upper:g})}}`"
    fields: dict[str, Any] = {"parameter": "ranges", "value": (lower, upper)}
    if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
        raise OptionError(
            f"{shown}: expected two finite numbers, the lower one first [{unit}]", **fields
        )
    if lower < limits[0] - _ROUNDING or upper > limits[1] + _ROUNDING:
        raise OptionError(
            f"{shown}: outside the joint's limits {limits[0]:.6g}:{limits[1]:.6g} [{unit}]",
            **fields,
        )
    if unit == "m" and upper - lower > _MAX_TRAVEL:
        raise OptionError(f"{shown}: expected a travel of at most {_MAX_TRAVEL:g} m", **fields)
    return max(lower, limits[0]), min(upper, limits[1])


def cut_to_one_turn(chosen: Range) -> tuple[Range, bool]:
    """Cut a revolute joint's range to one turn, centred as near to 0 as it allows.

    Returns the range and whether more than rounding was cut, which `notes_of_turns` tells
    """
    lower, upper = chosen
    if upper - lower <= TURN:
        return chosen, False
    # the turn around 0 where the range holds it, else the end that is nearest to 0
    centre = min(max(0.0, lower + TURN / 2), upper - TURN / 2)
    return (centre - TURN / 2, centre + TURN / 2), upper - lower > TURN + _ROUNDING


def notes_of_turns(cut: Mapping[str, Range]) -> list[str]:
    """Tell which joints' ranges were cut to one turn, a line for each range."""
    notes = []
    for lower, upper in dict.fromkeys(cut.values()):
        names = [repr(name) for name, turn in cut.items() if turn == (lower, upper)]
        joints = f"joint {names[0]}" if len(names) == 1 else f"joints {', '.join(names)}"
        notes.append(
            f"{joints} can turn more than once: one turn{'' if len(names) == 1 else ' each'} is "
            f"used, {lower:.4f} to {upper:.4f} rad"
        )
    return notes
