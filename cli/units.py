"""Units: how joint values and positions are typed and printed, and the SI units beneath."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from calib.common.wording import by_name, for_people, unit_of_joint, with_unit

from .output import with_decimals
from .parsing import BadOption, OfJoint, bad_value

if TYPE_CHECKING:
    from calib.arm.arm import Arm
    from calib.model.about import About


def units_of(about: About, positions: str | None = None) -> dict[str, object]:
    """Units of the numbers in a JSON document; errors and bounds have that of the positions."""
    return {
        "joints": by_name(about.joint_names, about.units_of_joints),
        "positions": positions or about.unit,
        "seconds": "s",
    }


class JointFormat:
    """How the values of a model's joints are typed and printed."""

    def __init__(self, about: About | Arm, degrees: bool) -> None:
        self.names = about.joint_names
        self.about = about
        self.degrees = degrees
        units = [
            unit_of_joint(revolute, degrees) for revolute in about.revolute
        ]
        self.to_typed = [factor for factor, _ in units]
        """Factors from SI units to what is typed, and written to tables of answers."""
        self._printed = [
            for_people(unit) if unit == "m" else (factor, unit)
            for factor, unit in units
        ]

    @property
    def header(self) -> list[str]:
        """Names of the joints with the units that they are printed in."""
        printed = zip(self.names, self._printed, strict=True)
        return [f"{name} [{unit}]" for name, (_, unit) in printed]

    def cells(self, q: Sequence[float]) -> list[str]:
        """Return joint values (dof,) [rad or m] as cells of a table."""
        return [
            with_decimals(value * factor, 6 if unit == "rad" else 4)
            for value, (factor, unit) in zip(q, self._printed, strict=True)
        ]

    def one_each(
        self, option: str, typed: Sequence[float] | None
    ) -> list[float] | None:
        """Return a value of each joint [rad or m] of what was typed for an option, if it was."""
        if typed is None:
            return None
        if len(typed) != len(self.names):
            shown = ",".join(f"{value:g}" for value in typed)
            expected = f"{len(self.names)} values, one each for {', '.join(self.names)}"
            raise bad_value(shown, expected, option)
        return [
            value / factor
            for value, factor in zip(typed, self.to_typed, strict=True)
        ]

    def change(self, k: int, value: float) -> str:
        """Return a change of joint `k` [rad or m] in words, in deg or mm."""
        return f"{self.names[k]} {with_unit(abs(value), self.about.units_of_joints[k])}"


def in_si(
    option: str,
    typed: Sequence[OfJoint] | None,
    revolute: Mapping[str, bool],
    degrees: bool,
) -> dict[str, tuple[float, float]]:
    """Return what was typed for joints in SI units, by joint."""
    values: dict[str, tuple[float, float]] = {}
    for value in typed or ():
        if value.joint in values:
            raise BadOption(
                f"{option} {value.joint!r} is given twice: expected each joint once"
            )
        in_degrees = degrees and revolute.get(value.joint, True)
        factor = math.radians(1.0) if in_degrees else 1.0
        values[value.joint] = (factor * value.low, factor * value.high)
    return values


def revolute_joints(robot: str) -> dict[str, bool]:
    """Return whether each movable joint of a robot turns."""
    from calib.arm.description import parse_robot
    from calib.arm.robot_text import read_robot_text
    from calib.arm.robots import resolve_robot

    # units are wanted before it is known which arm is loaded
    path = resolve_robot(robot)
    urdf = parse_robot(read_robot_text(path), path.stem)
    return {
        joint.name: joint.revolute for joint in urdf.joints if joint.movable
    }
