"""Units: how joint values are typed and printed, and the SI units beneath."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from calib.common.wording import for_people, unit_of_joint
from calib.model.facts import learned_range

from .output import fixed
from .parsing import BadOption, bad_option

if TYPE_CHECKING:
    from calib.arm.arm import Arm
    from calib.model.about import About
    from calib.model.model import Model


def units_of(about: About) -> dict[str, Any]:
    """Units of the numbers in a JSON document; errors and bounds have that of the positions."""
    joints = dict(zip(about.joint_names, about.units_of_joints, strict=True))
    return {"joints": joints, "positions": about.unit, "seconds": "s"}


class PositionFormat:
    """How a model's positions are typed and printed."""

    def __init__(
        self, about: About, frame: str = "sensor", unit: str | None = None
    ) -> None:
        self.unit = "m" if frame == "base" else about.unit
        self.factor, self.shown = for_people(self.unit)
        self.typed = 1.0
        """Factor from the model's unit to what is typed, and written to tables of answers."""
        if unit is not None:
            from calib.common.scale import METRES

            fitting = METRES if self.unit in METRES else {self.unit: 1.0}
            if unit not in fitting:
                expected = (
                    f"a unit that positions in {self.unit} have: {', '.join(fitting)}"
                )
                raise bad_option("--unit", unit, expected)
            self.typed = self.factor = fitting[unit] / fitting[self.unit]
            self.shown = unit

    def said(self, length: float) -> str:
        """Return a length [the model's unit] in words."""
        return f"{length * self.factor:.4g} {self.shown}"


class JointFormat:
    """How the values of a model's joints are typed and printed."""

    def __init__(self, about: About | Arm, degrees: bool) -> None:
        self.names = about.joint_names
        self.degrees = degrees
        self._about = about
        units = [unit_of_joint(turns, degrees) for turns in about.revolute]
        self.typed = [factor for factor, _ in units]
        """Factors from SI units to what is typed, and written to tables of answers."""
        self._units = [unit for _, unit in units]
        self._printed = [
            for_people(unit) if unit == "m" else (by, unit) for by, unit in units
        ]

    @property
    def header(self) -> list[str]:
        """Names of the joints with the units that they are printed in."""
        return [
            f"{n} [{unit}]"
            for n, (_, unit) in zip(self.names, self._printed, strict=True)
        ]

    def cells(self, q: Sequence[float]) -> list[str]:
        """Return joint values (dof,) [rad or m] as cells of a table."""
        return [
            fixed(value * factor, 6 if unit == "rad" else 4)
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
            raise bad_option(option, shown, expected)
        return [value / factor for value, factor in zip(typed, self.typed, strict=True)]

    def beyond(self, model: Model, q: Sequence[float]) -> str | None:
        """Say which joint of q (dof,) [rad or m] is outside of its learned range, None if none."""
        from calib.model.parts import ROUNDED

        about = model.about
        turns_round = model.motor.scale.periodic
        for k, (value, low, high) in enumerate(
            zip(q, about.lower, about.upper, strict=True)
        ):
            if turns_round[k] or max(low - value, value - high) <= ROUNDED * (
                high - low
            ):
                continue
            # below one turn a value may as well be a slip in rad: nothing is suggested
            fits = low <= math.radians(value) <= high and abs(value) > 2.0 * math.pi
            hint = about.revolute[k] and not self.degrees and fits
            return (
                f"{self.names[k]} = {value * self.typed[k]:.6g} {self._units[k]} is outside of the "
                f"learned range {learned_range(about, k, degrees=self.degrees)}"
                f"{'; as degrees it fits: give --degrees' if hint else ''}"
            )
        return None

    def change(self, k: int, value: float) -> str:
        """Return a change of joint `k` [rad or m] in words, in deg or mm."""
        factor, unit = for_people(self._about.units_of_joints[k])
        return f"{self.names[k]} {abs(value) * factor:.4g} {unit}"


def in_si(
    option: str,
    typed: Sequence[tuple[Any, ...]] | None,
    turns: Mapping[str, bool],
    degrees: bool,
) -> dict[str, Any]:
    """Return what was typed for joints, a value or a range each, in SI units by joint."""
    values_by_joint: dict[str, Any] = {}
    for joint, *values in typed or ():
        if joint in values_by_joint:
            raise BadOption(
                f"{option} {joint!r} is given twice: expected each joint once"
            )
        factor = math.radians(1.0) if degrees and turns.get(joint, True) else 1.0
        scaled = tuple(value * factor for value in values)
        values_by_joint[joint] = scaled if len(scaled) > 1 else scaled[0]
    return values_by_joint


def kinds_of_joints(robot: str) -> dict[str, bool]:
    """Return whether each movable joint of a robot turns."""
    from calib.arm.description import parse_robot
    from calib.arm.robots import resolve_robot
    from calib.arm.urdf import read_urdf

    # without Pinocchio: units are wanted before it is known which arm is loaded
    path = resolve_robot(robot)
    urdf = parse_robot(read_urdf(path), path.stem)
    return {joint.name: joint.revolute for joint in urdf.joints if joint.movable}
