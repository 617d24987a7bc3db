"""Ranges: the part of a joint's travel that is babbled and learned."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..common.scale import TURN
from ..common.wording import listed
from ..errors import OptionError, RobotError
from .urdf import MAX_TRAVEL, Joint
from .urdf import Range as Range

#: Limits that exceed one turn or a range that exceeds its limits by less than this are
#: rounding (3.1416, 1.5708), and are clipped in silence.
_ROUNDING = 1e-3


def check_joint_limits(joints: Sequence[Joint]) -> None:
    """Ask for `ranges` of all joints whose limits are unusable."""
    if faulty := [joint for joint in joints if joint.fault]:
        faults = "; ".join(f"joint {j.name!r} cannot be babbled, {j.fault}" for j in faulty)
        wanted = ", ".join(f"{joint.name!r}: (LOWER, UPPER)" for joint in faulty)
        units = ", ".join(sorted({joint.unit for joint in faulty}))
        raise RobotError(faults, hint=f"give `ranges={{{wanted}}}` [{units}]", parameter="ranges")


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
    if unit == "m" and upper - lower > MAX_TRAVEL:
        raise OptionError(f"{shown}: expected a travel of at most {MAX_TRAVEL:g} m", **fields)
    return max(lower, limits[0]), min(upper, limits[1])


def one_turn(chosen: Range) -> Range:
    """Cut a turning joint's range to one turn, centred as near to 0 as it allows."""
    lower, upper = chosen
    if upper - lower <= TURN:
        return chosen
    # the turn around 0 where the range holds it, else the end that is nearest to 0
    centre = min(max(0.0, lower + TURN / 2), upper - TURN / 2)
    return centre - TURN / 2, centre + TURN / 2


def notes_of_turns(chosen: Mapping[str, Range]) -> list[str]:
    """Tell of which turning joints' ranges more than rounding is cut to one turn."""
    cut = [repr(name) for name, (low, high) in chosen.items() if high - low > TURN + _ROUNDING]
    return [f"{listed(cut)} can turn more than once: one turn of each is used"] if cut else []
