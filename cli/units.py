"""Units: what people read and type, and the SI units beneath."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from calib.common.wording import for_people, unit_of_joint
from calib.show.facts import learned_range

from .output import fixed
from .parsing import JointRange, JointValue
from .usage import BadOption, bad_option

if TYPE_CHECKING:
    from calib.arm.arm import Arm
    from calib.model.about import About
    from calib.model.model import Model
    from calib.samples.changes import Change


def units_of(about: About, frame: str = "sensor") -> dict[str, Any]:
    """Units of the numbers in a JSON document; positions of the base frame are in m.

    Errors, bounds and distances have the unit of the positions, times are in seconds.
    """
    joints = dict(zip(about.joint_names, about.units_of_joints, strict=True))
    unit = "m" if frame == "base" else about.unit
    return {"joints": joints, "positions": unit, "seconds": "s"}


def meaning(about: About, frame: str = "sensor") -> dict[str, Any]:
    """What the numbers of an answer mean, for JSON: their units, and what a bound is of."""
    if frame == "base":
        units = units_of(about, frame)
        return {"frame": frame, "unit": "m", "bound_of": "true position", "units": units}
    return {"unit": about.unit, "bound_of": about.bound_of, "units": units_of(about)}


class JointFormat:
    """How the values of a model's joints are typed and printed.

    about : which joints there are, and which of them turn
    degrees : whether those that turn are in degrees, else in rad. What slides is typed in m and
        printed in mm.
    """

    def __init__(self, about: About | Arm, degrees: bool) -> None:
        self.names = about.joint_names
        self._about = about
        self.degrees = degrees

    @property
    def typed(self) -> list[float]:
        """Factors from SI units to what is typed, and written to tables of answers."""
        return [unit_of_joint(turns, self.degrees)[0] for turns in self._about.revolute]

    def in_si(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Columns of a table of answers in SI units, as a JSON document holds them."""
        factors = dict(zip(self.names, self.typed, strict=True))
        return {
            name: column / factors[name] if name in factors else column
            for name, column in columns.items()
        }

    @property
    def header(self) -> list[str]:
        """Names of the joints with their units."""
        return [f"{name} [{self._printed(k)[1]}]" for k, name in enumerate(self.names)]

    def cell(self, k: int, value: float) -> str:
        """Return a value of joint `k` [rad or m] as a cell of a table."""
        factor, unit = self._printed(k)
        return fixed(value * factor, 6 if unit == "rad" else 4)

    def learned_range(self, k: int) -> str:
        """Return the learned range of joint `k` in words."""
        return learned_range(self._about, k, degrees=self.degrees)

    def value(self, k: int, value: float) -> str:
        """Return a value of joint `k` [rad or m] in words."""
        factor, unit = unit_of_joint(self._about.revolute[k], self.degrees)
        return f"{self.names[k]} = {value * factor:.6g} {unit}"

    def hint(self, k: int, value: float) -> str:
        """Return what to do if a value of joint `k` [rad] outside of its range fits in degrees."""
        low, high = self._about.lower[k], self._about.upper[k]
        # below one turn a value may as well be a slip in rad: nothing is suggested
        fits = low <= math.radians(value) <= high and abs(value) > 2.0 * math.pi
        far = self._about.revolute[k] and not self.degrees and fits
        return "; as degrees it fits: give --degrees" if far else ""

    def one_each(self, option: str, typed: Sequence[float] | None) -> list[float] | None:
        """Return a value of each joint [rad or m] of what was typed for an option, if it was.

        Raises BadOption if there are more or fewer.
        """
        if typed is None:
            return None
        if len(typed) != len(self.names):
            shown = ",".join(f"{value:g}" for value in typed)
            expected = f"{len(self.names)} values, one each for {', '.join(self.names)}"
            raise bad_option(option, shown, expected)
        return [value / factor for value, factor in zip(typed, self.typed, strict=True)]

    def of_change(self, k: int) -> tuple[float, str]:
        """Return the factor and the unit in which a change of joint `k` is printed."""
        return for_people(self._about.units_of_joints[k])

    def size(self, k: int, value: float) -> str:
        """Return a change of joint `k` [rad or m] in words, in deg or mm."""
        factor, unit = self.of_change(k)
        return f"{self.names[k]} {abs(value) * factor:.4g} {unit}"

    def _printed(self, k: int) -> tuple[float, str]:
        if self._about.revolute[k]:
            return for_people("rad") if self.degrees else (1.0, "rad")
        return for_people("m")


def why_outside(joints: JointFormat, model: Model, q: Sequence[float]) -> str | None:
    """Name the joint that is furthest beyond its learned range, in the units typed."""
    from calib.model.trust import ROUNDED

    about = model.about
    # as shares of the ranges, since rad and m do not compare
    excess = [
        0.0 if turns_round else max(low - value, value - high) / (high - low)
        for value, low, high, turns_round in zip(
            q, about.lower, about.upper, model.motor.scale.periodic, strict=True
        )
    ]
    k = max(range(len(q)), key=lambda i: excess[i])
    if excess[k] <= ROUNDED:
        return None
    return (
        f"{joints.value(k, q[k])} is outside of the learned range {joints.learned_range(k)}"
        f"{joints.hint(k, q[k])}"
    )


def kinds_of_joints(robot: str) -> dict[str, bool]:
    """Return whether each movable joint of a robot turns."""
    from calib.arm.robots import resolve_robot
    from calib.arm.urdf import parse_urdf, read_urdf

    # without Pinocchio: units are wanted before it is known which arm is loaded
    path = resolve_robot(robot)
    urdf = parse_urdf(read_urdf(path), path.stem)
    return {joint.name: joint.revolute for joint in urdf.joints if joint.movable}


def ranges_in_si(
    ranges: Sequence[JointRange], turns: Mapping[str, bool], degrees: bool
) -> dict[str, tuple[float, float]]:
    """Return ranges as typed in SI units, by joint; `turns` tells which joints turn.

    Joints that it does not know are told by whoever knows the arm.
    """
    _check_once("--range", [joint for joint, *_ in ranges], "range")
    factors = {joint: _in_si(joint, turns, degrees) for joint, *_ in ranges}
    return {joint: (low * factors[joint], high * factors[joint]) for joint, low, high in ranges}


def locks_in_si(
    locks: Sequence[JointValue], turns: Mapping[str, bool], degrees: bool
) -> dict[str, float]:
    """Return locked joints and their values in SI units; see `ranges_in_si`."""
    _check_once("--lock", [joint for joint, _ in locks], "value")
    return {joint: value * _in_si(joint, turns, degrees) for joint, value in locks}


def _in_si(joint: str, turns: Mapping[str, bool], degrees: bool) -> float:
    return math.radians(1.0) if degrees and turns.get(joint, True) else 1.0


def _check_once(option: str, joints: Sequence[str], what: str) -> None:
    for joint in joints:
        if joints.count(joint) > 1:
            raise BadOption(
                f"{option} {joint!r} is given twice: expected one {what} for each joint"
            )


def changes_in_si(texts: Iterable[str], arm: Arm, degrees: bool) -> tuple[Change, ...]:
    """Read changes of an arm as typed; what is no change is wrong usage."""
    from calib.errors import OptionError
    from calib.samples.changes import parse_changes

    turning = [name for name, turns in zip(arm.joint_names, arm.revolute, strict=True) if turns]
    try:
        return parse_changes(texts, degrees=turning if degrees else ())
    except OptionError as error:
        raise BadOption(f"--{error}") from None
