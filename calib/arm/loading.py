"""Loading: find an arm in a robot and load it, its kinematics computed by Pinocchio.

A planar arm is a serial chain whose active revolute axes are all parallel to one normal and
whose active prismatic axes are all perpendicular to it. Any other serial chain is a spatial
arm. Joints that are not active are locked.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..common.wording import listed, one_line, quoted, suggestion
from ..errors import OptionError, RobotError
from .arm import PlanarArm, SpatialArm
from .finding import (
    MOST_JOINTS,
    TIP_NAMES,
    Chain,
    check_tip,
    find_chains,
    find_tip,
    planar_part,
    plane_normal,
)
from .plane import plane_of
from .posture import Kinematics, Posture, folded
from .robots import resolve_robot
from .urdf import Joint, Mimic, Range, Urdf, parse_urdf, read_urdf

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
        Active joints in any order, 2 to 7; by default those of the chain that reaches furthest,
        before its hand.
    tip : str, optional
        The link (or the fixed joint) whose position is sensed.
    lock : mapping of str to float, optional
        Values [rad or m] at which other joints are held (default: neutral).
    ranges : mapping of str to (lower, upper), optional
        Part of a joint's range [rad or m] to babble and learn.
    planar : bool
        Whether to take only the joints that move the tip within one plane.
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
    lock, ranges = dict(lock or {}), dict(ranges or {})
    for locked in lock:
        _movable(urdf, locked, "lock")
    wanted = None if tip is None else _find_link(urdf, tip)
    kinematics, values = Kinematics(urdf), held_values(urdf, lock)
    if joints is None:
        usable = [
            joint
            for joint in urdf.joints
            if joint.movable and not joint.mimic and joint.name not in lock
            and (joint.name in ranges or not joint.stuck)
        ]  # fmt: skip
        free = [joint for joint in usable if columns is None or joint.name in columns]
        posture, logged = kinematics.posture(values), columns is not None
        active, tip, notes = _found(urdf, posture, free, wanted, lock, planar=planar, logged=logged)
        if idle := [
            joint.name for joint in urdf.path(tip) if joint in usable and joint not in free
        ]:
            notes.append(f"locked because the log has no columns for them: {listed(idle)}")
    else:
        named = re.split(r"\s*,\s*", joints.strip()) if isinstance(joints, str) else joints
        active, tip = _named(urdf, named, wanted, lock)
        notes = []
    if wanted is None and not tip.lower().endswith(TIP_NAMES):
        notes.append(f"tip {quoted(tip)} was chosen (`tip` changes it)")
    names, following = [joint.name for joint in active], dict[str, Mimic]()
    for joint in urdf.path(tip):
        if joint.movable and (mimic := urdf.followed(joint, lock)).leader in names:
            following[joint.name] = mimic
    copies = [name for name in following if name not in names]
    posture = kinematics.posture({**values, **dict.fromkeys(following, 0.0)})
    normal = plane_normal(active, posture, wanted=planar)
    if copies and planar:
        raise RobotError(
            f"joint {quoted(copies[0])} mimics the active {quoted(following[copies[0]].leader)} on "
            "the way to the tip: expected no such joint in a planar arm; choose others"
        )
    normal = None if copies else normal
    if normal is None and len(active) > MOST_JOINTS:
        raise OptionError(
            f"`joints` names {len(active)} joints, expected 2 to {MOST_JOINTS}",
            hint="lock the others",
            parameter="joints",
        )
    stay = {j.name: values[j.name] for j in urdf.path(tip) if j.movable and j.name not in following}
    if normal is not None:
        check_tip(active[-1], tip, posture)
    others = [joint for joint in active if joint.name not in ranges]
    _check_limits(others)
    parts: dict[str, Any] = {
        "name": urdf.name,
        "joint_names": tuple(names),
        "lower": np.zeros(len(active)),
        "upper": np.zeros(len(active)),
        "revolute": tuple(joint.revolute for joint in active),
        "tip": tip,
        "locked": stay,
        "urdf": text,
        "notes": tuple(map(one_line, (*urdf.notes, *notes, *_lock_notes(urdf, stay, lock)))),
        "limits": tuple(joint.travel for joint in active),
        "chain": folded(urdf, following, names, tip, posture, weighed=normal is None),
    }
    arm: PlanarArm | SpatialArm = (
        SpatialArm(**parts)
        if normal is None
        else PlanarArm(plane=plane_of(normal, posture.place(tip)), **parts)
    )
    return arm.with_range({**ranges, **{joint.name: joint.travel for joint in others}})


def _found(
    urdf: Urdf,
    posture: Posture,
    free: Sequence[Joint],
    tip: str | None,
    lock: Mapping[str, float],
    *,
    planar: bool,
    logged: bool,
) -> tuple[list[Joint], str, list[str]]:
    """Return active joints, base to tip, and the tip, for users who named none; and notes."""
    chains = find_chains(urdf, posture, free, tip)
    if not chains:
        stuck = [joint for joint in urdf.joints if joint.stuck and joint.name not in lock]
        if len(free) + len(stuck) > 1:
            _check_limits([joint for joint in stuck if joint not in free])
        hint = "if columns have other names, give `columns={'JOINT': 'COLUMN'}`"
        movable = listed(joint.name for joint in urdf.joints if joint.movable)
        raise RobotError(
            f"no arm{f' to {quoted(tip)}' if tip else ''}: it needs two joints in one chain; of "
            f"the movable joints {movable} these are free: {listed(j.name for j in free)}",
            hint=hint if logged else "name other `joints`, `tip` or `lock`",
        )
    parts = [planar_part(chain, posture) for chain in chains]
    flat = planar or plane_normal(chains[0].joints, posture) is not None
    if flat:
        chains = [part or chain for part, chain in zip(parts, chains, strict=True)]
    else:
        chains = [replace(chain, joints=chain.joints[-MOST_JOINTS:]) for chain in chains]
    best, *others = chains
    if others and logged:  # a log was measured on one of them only; in simulation the first serves
        raise RobotError(
            f"the robot has {len(chains)} arms of one reach, choose one: {_of(chains)}"
        )
    notes = [f"chosen by reach: {best} (others: {_of(others)})"] if others else []
    if parts[0] and not flat:
        notes.append(f"the arm moves in space; `planar=True` takes its planar part: {parts[0]}")
    return list(best.joints), best.tip, notes


def _of(chains: Sequence[Chain], most: int = 6) -> str:
    """The options that name each chain, the first `most` of them."""
    return "; ".join(map(str, chains[:most])) + ("; ..." if len(chains) > most else "")


def _named(
    urdf: Urdf, joints: Sequence[str], tip: str | None, lock: Mapping[str, float]
) -> tuple[list[Joint], str]:
    """Return the joints that a user named, base to tip, and the tip."""
    active: list[Joint] = []
    for name in joints:
        joint = _movable(urdf, name, "joints")
        held = "locked" if name in lock else "named already" if joint in active else None
        held = f"a mimic of {quoted(joint.mimic.leader)}" if joint.mimic else held
        if held:
            raise OptionError(
                f"`joints`: {quoted(name)} is {held}: expected joints that move on their own",
                parameter="joints",
                value=name,
            )
        active.append(joint)
    if len(active) < 2:
        raise OptionError(
            f"`joints` names {len(active)} joint, expected two or more: one alone moves the "
            "tip along a line, not over a plane",
            parameter="joints",
            value=list(joints),
        )
    if tip is None:
        tip = find_tip(urdf, max(active, key=lambda joint: len(urdf.path(joint.child))).child)
    path = urdf.path(tip)
    for joint in active:
        if joint not in path:
            raise RobotError(
                f"joint {quoted(joint.name)} does not move the tip {quoted(tip)}: joints that "
                f"do: {listed(j.name for j in path if j.movable)}"
            )
    return [joint for joint in path if joint in active], tip


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


def _check_limits(joints: Sequence[Joint]) -> None:
    """Ask for `ranges` of all joints whose limits are unusable."""
    if faulty := [joint for joint in joints if joint.fault]:
        faults = "; ".join(f"joint {j.name!r} cannot be babbled, {j.fault}" for j in faulty)
        wanted = ", ".join(f"{joint.name!r}: (LOWER, UPPER)" for joint in faulty)
        units = ", ".join(sorted({joint.unit for joint in faulty}))
        raise RobotError(faults, hint=f"give `ranges={{{wanted}}}` [{units}]", parameter="ranges")


def held_values(urdf: Urdf, lock: Mapping[str, float]) -> dict[str, float]:
    """Values of all movable joints when held: as told, as their leader, or neutral."""
    movable = [joint for joint in urdf.joints if joint.movable]
    values = {joint.name: float(lock.get(joint.name, joint.neutral)) for joint in movable}
    for joint in movable:
        if not np.isfinite(values[joint.name]):
            raise OptionError(
                f"`lock` of {quoted(joint.name)} is {lock[joint.name]}: expected a finite "
                f"number [{joint.unit}]",
                parameter="lock",
                value=lock[joint.name],
            )
    mimics = {joint.name: urdf.followed(joint, lock) for joint in movable}
    return {
        name: mimic.multiplier * values[mimic.leader] + mimic.offset
        if mimic.leader in values
        else values[name]
        for name, mimic in mimics.items()
    }


def _lock_notes(urdf: Urdf, held: Mapping[str, float], lock: Mapping[str, float]) -> list[str]:
    """Say which joints are held where, and where that is not what zero or limits say."""
    notes: list[str] = []
    for name in [name for name in held if name in lock]:
        joint = _movable(urdf, name, "lock")
        lower, upper = joint.travel
        if not lower <= held[name] <= upper:
            notes.append(
                f"`lock={{{name!r}: {held[name]:g}}}` lies outside the joint's limits "
                f"{lower:g}:{upper:g} [{joint.unit}]"
            )
    if neutral_ones := [f"{name}={held[name]:.4g}" for name in held if name not in lock]:
        notes.append(f"locked at neutral: {listed(neutral_ones, 8)} (`lock` changes it)")
    return notes
