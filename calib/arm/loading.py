"""Loading: find an arm in a robot and load it, its kinematics computed by Pinocchio.

A planar arm is a serial chain whose active revolute axes are all parallel to one normal and
whose active prismatic axes are all perpendicular to it. Any other serial chain is a spatial
arm. Joints that are not active are locked.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..common.wording import listed, one_line, quoted, suggestion
from ..errors import OptionError, RobotError
from .arm import PlanarArm, SpatialArm
from .finding import MOST_JOINTS, Choice, find_arm, find_tip, is_flat
from .plane import check_tip, common_normal, plane_of
from .posture import Kinematics, Posture, folded, followers
from .ranges import Range, check_joint_limits, neutral, travel, unit_of
from .robots import resolve_robot
from .urdf import Joint, Urdf, parse_urdf, read_urdf

__all__ = ["PlanarArm", "SpatialArm", "arm_from_urdf", "load_arm"]


def load_arm(
    robot: str | Path,
    joints: Sequence[str] | None = None,
    tip: str | None = None,
    *,
    lock: Mapping[str, float] | None = None,
    ranges: Mapping[str, Range] | None = None,
    planar: bool = False,
    columns: Collection[str] | None = None,
) -> PlanarArm | SpatialArm:
    """Load an arm from a URDF file or from the bundled robots.

    Parallel axes make a planar arm, whose positions are x and y in its plane. Any others make a
    spatial arm, whose positions are x, y and z in the root link's frame.

    Parameters
    ----------
    robot : str or Path
        Path to a URDF, or the name of a bundled robot.
    joints : sequence of str, optional
        Active joints in any order, 2 to 7; by default those of the arm that reaches furthest,
        before its fingers.
    tip : str, optional
        The link (or the fixed joint) whose position is sensed.
    lock : mapping of str to float, optional
        Values [rad or m] at which other joints are held (default: neutral).
    ranges : mapping of str to (lower, upper), optional
        Part of a joint's range [rad or m] to babble and learn.
    planar : bool
        Whether to look only for planar arms within the robot.
    columns : collection of str, optional
        Columns of a log: without `joints`, joints that are none of them are locked.

    Returns
    -------
    PlanarArm or SpatialArm
        What was chosen or assumed stands in its `notes`.

    Raises
    ------
    RobotError, OptionError
        In one line, naming what was given, what was expected and what to do.

    Examples
    --------
    >>> import calib
    >>> arm = calib.load_arm("two_link")
    >>> arm.joint_names, arm.tip, arm.forward([0.0, 0.0]).round(3).tolist()
    (('shoulder', 'elbow'), 'tip', [0.55, 0.0])
    """
    path = resolve_robot(robot)
    try:
        return arm_from_urdf(
            read_urdf(path), joints, tip, lock=lock, ranges=ranges, name=path.stem, planar=planar,
            columns=columns,
        )  # fmt: skip
    except RobotError as error:
        raise error.within(path.name) from None


def arm_from_urdf(
    text: str,
    joints: Sequence[str] | None = None,
    tip: str | None = None,
    *,
    lock: Mapping[str, float] | None = None,
    ranges: Mapping[str, Range] | None = None,
    name: str = "robot",
    planar: bool = False,
    columns: Collection[str] | None = None,
) -> PlanarArm | SpatialArm:
    """Build an arm from the text of a URDF; see `load_arm`.

    `name` is used where the URDF gives its robot none.
    """
    urdf = parse_urdf(text, name)
    notes = list(urdf.notes)
    lock, ranges = dict(lock or {}), dict(ranges or {})
    if isinstance(joints, str):
        joints = [joint.strip() for joint in joints.split(",")]
    for locked in lock:
        _movable(urdf, locked, "lock")
    tip = None if tip is None else _find_link(urdf, tip)
    kinematics = Kinematics(urdf)
    values = held_values(urdf, lock)
    choice = Choice(joints, tip, lock, ranges, planar, columns)
    active, tip, flat = _select(urdf, kinematics.posture(values), choice, notes)
    path = urdf.path(tip)
    following = followers(urdf, path, active)
    if flat and following:
        name, (leader, _, _) = next(iter(following.items()))
        raise RobotError(
            f"joint {quoted(name)} mimics the active {quoted(leader)} on the way to the tip: "
            "coupled joints are not supported in a planar arm; choose others"
        )
    moving = [joint for joint in path if joint in active or joint.name in following]
    posture = kinematics.posture({**values, **{joint.name: 0.0 for joint in moving}})
    held = {j.name: values[j.name] for j in path if j.movable and j not in moving}
    notes += _lock_notes(urdf, held, lock)
    parts: dict[str, Any] = {
        "name": urdf.name,
        "joint_names": tuple(joint.name for joint in active),
        "lower": np.zeros(len(active)),
        "upper": np.zeros(len(active)),
        "revolute": tuple(joint.revolute for joint in active),
        "tip": tip,
        "locked": held,
        "urdf": text,
        "notes": tuple(map(one_line, notes)),
        "limits": tuple(travel(joint) for joint in active),
        "chain": folded(moving, active, following, tip, posture, None if flat else urdf),
    }
    arm: PlanarArm | SpatialArm
    if flat:
        check_tip(active[-1], tip, urdf, posture)
        plane = plane_of(common_normal(active, posture), posture.links[tip])
        arm = PlanarArm(plane=plane, **parts)
    else:
        arm = SpatialArm(**parts)
    others = [joint for joint in active if joint.name not in ranges]
    check_joint_limits(others)
    return arm.with_range(ranges).spanning({joint.name: travel(joint) for joint in others})


def _select(
    urdf: Urdf, posture: Posture, choice: Choice, notes: list[str]
) -> tuple[list[Joint], str, bool]:
    """Return the active joints, base to tip, the tip link, and whether the arm is planar."""
    if choice.joints is None:
        found, note = find_arm(urdf, posture, choice)
        notes += note
        return found
    active = _named_joints(urdf, choice.joints, choice.lock)
    tip = choice.tip
    if tip is None:
        last = max(active, key=lambda joint: len(urdf.path(joint.child)))
        tip = find_tip(urdf, last.child)
        if sum(last in urdf.path(link) for link in urdf.links) > 2:  # more than link and tip
            notes.append(f"tip {quoted(tip)} was chosen (`tip` changes it)")
    path = urdf.path(tip)
    for joint in active:
        if joint not in path:
            raise RobotError(
                f"joint {quoted(joint.name)} does not move the tip {quoted(tip)}: joints that "
                f"do: {listed(j.name for j in path if j.movable)}"
            )
    active = [joint for joint in path if joint in active]
    flat = choice.planar or is_flat(urdf, posture, active, tip)
    if flat:
        common_normal(active, posture)
    elif len(active) > MOST_JOINTS:
        raise OptionError(
            f"`joints` names {len(active)} joints, expected 2 to {MOST_JOINTS}",
            hint="lock the others",
            parameter="joints",
        )
    return active, tip, flat


def _named_joints(urdf: Urdf, joints: Sequence[str], lock: Mapping[str, float]) -> list[Joint]:
    active: list[Joint] = []
    for name in joints:
        joint = _movable(urdf, name, "joints")
        if joint.mimic:
            raise RobotError(
                f"joint {quoted(name)} mimics {quoted(joint.mimic.leader)} and cannot move on "
                "its own: choose that one"
            )
        if joint in active:
            raise OptionError(f"`joints` has {quoted(name)} twice", parameter="joints", value=name)
        if name in lock:
            raise OptionError(f"joint {quoted(name)} is both active and locked: choose one")
        active.append(joint)
    if len(active) < 2:
        raise OptionError(
            f"`joints` names {len(active)} joint, expected two or more: one alone moves the "
            "tip along a line, not over a plane",
            parameter="joints",
            value=list(joints),
        )
    return active


def _movable(urdf: Urdf, name: str, parameter: str) -> Joint:
    """Return the movable joint of a name, or say which there are."""
    joint = urdf.joint(name)
    if joint is None or not joint.movable:
        what = f"joint {quoted(name)} {'does not exist' if joint is None else 'is fixed'}"
        hint = suggestion(name, [j.name for j in urdf.joints if j.movable])
        raise RobotError(f"`{parameter}`: {what}", hint=hint, parameter=parameter, value=name)
    return joint


def _find_link(urdf: Urdf, tip: str) -> str:
    """Return the link of a frame's name: a link, or the child of a joint."""
    joint = urdf.joint(tip)
    if tip not in urdf.links and joint is None:
        what, hint = f"`tip`: frame {quoted(tip)} does not exist", suggestion(tip, urdf.links)
        raise RobotError(what, hint=hint, parameter="tip", value=tip)
    return tip if tip in urdf.links or joint is None else joint.child


def held_values(urdf: Urdf, lock: Mapping[str, float]) -> dict[str, float]:
    """Values of all movable joints when held: as told, as their leader, or neutral."""
    movable = [joint for joint in urdf.joints if joint.movable]
    values = {joint.name: float(lock.get(joint.name, neutral(joint))) for joint in movable}
    for joint in movable:
        if not np.isfinite(values[joint.name]):
            raise OptionError(
                f"`lock` of {quoted(joint.name)} is {lock[joint.name]}: expected a finite "
                f"number [{unit_of(joint)}]",
                parameter="lock",
                value=lock[joint.name],
            )
        if joint.mimic and joint.mimic.leader in values and joint.name not in lock:
            leader = values[joint.mimic.leader]
            values[joint.name] = joint.mimic.multiplier * leader + joint.mimic.offset
    return values


def _lock_notes(urdf: Urdf, held: Mapping[str, float], lock: Mapping[str, float]) -> list[str]:
    """Say which joints are held where, and where that is not what zero or limits say."""
    notes: list[str] = []
    for name in [name for name in held if name in lock]:
        joint = _movable(urdf, name, "lock")
        lower, upper = travel(joint)
        if not lower <= held[name] <= upper:
            notes.append(
                f"`lock={{{name!r}: {held[name]:g}}}` lies outside the joint's limits "
                f"{lower:g}:{upper:g} [{unit_of(joint)}]"
            )
    if neutral_ones := [f"{name}={held[name]:.4g}" for name in held if name not in lock]:
        notes.append(f"locked at neutral: {listed(neutral_ones, 8)} (`lock` changes it)")
    if idle := [name for name in lock if name not in held]:
        notes.append(f"locked joints that do not move the tip: {listed(idle)}")
    return notes
