"""Loading: find an arm in a robot and load it.

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
from .description import parse_robot
from .finding import (
    FINDING,
    TIP_NAMES,
    Chain,
    check_tip,
    find_chains,
    find_tip,
    planar_part,
    plane_normal,
)
from .gravity import standard
from .plane import plane_of
from .posture import Posture, folded, posture_of
from .robot_text import read_urdf
from .robots import resolve_robot
from .urdf import Joint, Mimic, Range, Urdf

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
    gravity: Sequence[float] | None = None,
) -> PlanarArm | SpatialArm:
    """Load an arm from a URDF or MJCF file or from the bundled robots.

    Parallel axes make a planar arm, whose positions are x and y in its plane. Any others make a
    spatial arm, whose positions are x, y and z in the root link's frame.

    Parameters
    ----------
    robot : str or Path
        Path to a URDF or an MJCF, or the name of a bundled robot.
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
    gravity : (3,) sequence of float, optional
        Where gravity points in the root link's frame, of an arm on a wall or a ceiling; of any
        length. By default along its -z.

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
    text = read_urdf(path)
    try:
        arm = arm_from_urdf(
            text,
            joints,
            tip,
            lock=lock,
            ranges=ranges,
            name=path.stem,
            planar=planar,
            columns=columns,
        )
    except RobotError as error:
        raise error.within(path.name) from None
    return arm if gravity is None else replace(arm, gravity=standard(gravity))


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
    urdf = parse_robot(text, name)
    lock = dict(lock or {})
    ranges = dict(ranges or {})
    for joint_name, value in lock.items():
        unit = _movable(urdf, joint_name, "lock").unit
        if not np.isfinite(value):
            raise OptionError(
                f"`lock` of {quoted(joint_name)} is {value}: expected a finite number [{unit}]",
                parameter="lock",
                value=value,
            )
    link = None if tip is None else _link(urdf, tip)
    posture = posture_of(urdf, lock)
    # joints that move on their own
    free = [
        j
        for j in urdf.joints
        if j.movable and not j.mimic and j.name not in lock
    ]
    notes: list[str] = []
    if joints is None:
        usable = [j for j in free if j.name in ranges or not j.stuck]
        chain, notes = _furthest(urdf, posture, usable, link, planar, columns)
    else:
        if isinstance(joints, str):
            joints = re.split(r"\s*,\s*", joints.strip())
        chain = _named(urdf, posture, joints, link, free)
    tip = chain.tip
    if link is None and not tip.lower().endswith(TIP_NAMES):
        notes.append(f"tip {quoted(tip)} was chosen (`tip` changes it)")
    active = chain.joints
    names = [joint.name for joint in active]
    # what each joint on the way to the tip follows, of those that active ones move
    following: dict[str, Mimic] = {}
    for joint in urdf.path(tip):
        mimic = urdf.followed(joint, lock)
        if joint.movable and mimic.leader in names:
            following[joint.name] = mimic
    posture = posture_of(urdf, {**lock, **dict.fromkeys(following, 0.0)})
    normal = plane_normal(active, posture, wanted=planar)
    copies = [name for name in following if name not in names]
    if copies and planar:
        raise RobotError(
            f"joint {quoted(copies[0])} mimics the active {quoted(following[copies[0]].leader)} on "
            "the way to the tip: expected no such joint in a planar arm; choose others"
        )
    if copies:
        normal = None
    if normal is not None:
        check_tip(active[-1], tip, posture)
    elif len(active) > FINDING.most_joints:
        raise OptionError(
            f"`joints` names {len(active)} joints, expected 2 to {FINDING.most_joints}",
            hint="lock the others",
            parameter="joints",
        )
    limited = [joint for joint in active if joint.name not in ranges]
    _check_limits(limited)
    values = urdf.values(lock)
    locked = {
        joint.name: values[joint.name]
        for joint in urdf.path(tip)
        if joint.movable and joint.name not in following
    }
    neutral = [
        f"{name}={value:.4g}"
        for name, value in locked.items()
        if name not in lock
    ]
    if neutral:
        notes.append(
            f"locked at neutral: {listed(neutral, 8)} (`lock` changes it)"
        )
    travel = tuple(joint.travel for joint in active)
    parts: dict[str, Any] = {
        "name": urdf.name,
        "joint_names": tuple(names),
        "lower": np.zeros(len(active)),
        "upper": np.zeros(len(active)),
        "revolute": tuple(joint.revolute for joint in active),
        "tip": tip,
        "locked": locked,
        "urdf": text,
        "notes": tuple(map(one_line, (*urdf.notes, *notes))),
        "limits": travel,
        "travel": travel,
        "chain": folded(
            urdf, following, names, tip, posture, weighed=normal is None
        ),
    }
    arm: PlanarArm | SpatialArm
    if normal is None:
        arm = SpatialArm(**parts)
    else:
        arm = PlanarArm(plane=plane_of(normal, posture.place(tip)), **parts)
    return arm.with_range(
        {**ranges, **{joint.name: joint.travel for joint in limited}}
    )


def _furthest(
    urdf: Urdf,
    posture: Posture,
    usable: Sequence[Joint],
    tip: str | None,
    planar: bool,
    columns: Collection[str] | None,
) -> tuple[Chain, list[str]]:
    """Return the arm for users who named no joints, and notes."""
    free = [j for j in usable if columns is None or j.name in columns]
    chains = find_chains(urdf, posture, free, tip)
    if not chains:
        stuck = [joint for joint in urdf.joints if joint.stuck]
        stuck = [joint for joint in stuck if joint not in free]
        if len(free) + len(stuck) > 1:
            _check_limits(stuck)
        hint = "name other `joints`, `tip` or `lock`"
        if columns is not None:
            hint = "if columns have other names, give `columns={'JOINT': 'COLUMN'}`"
        movable = listed(joint.name for joint in urdf.joints if joint.movable)
        raise RobotError(
            f"no arm{f' to {quoted(tip)}' if tip else ''}: it needs two joints in one chain; of "
            f"the movable joints {movable} these are free: {listed(j.name for j in free)}",
            hint=hint,
        )
    parts = [planar_part(chain, posture) for chain in chains]
    flat = planar or plane_normal(chains[0].joints, posture) is not None
    if flat:
        chains = [
            part or chain for part, chain in zip(parts, chains, strict=True)
        ]
    else:
        chains = [
            replace(chain, joints=chain.joints[-FINDING.most_joints :])
            for chain in chains
        ]
    best = chains[0]
    others = "; ".join(map(str, chains[1:]))
    # a log was measured on one of them only; in simulation the first serves
    if others and columns is not None:
        raise RobotError(
            f"the robot has {len(chains)} arms of one reach, choose one: {best}; {others}"
        )
    notes: list[str] = []
    if others:
        notes.append(f"chosen by reach: {best} (others: {others})")
    if parts[0] and not flat:
        notes.append(
            f"the arm moves in space; `planar=True` takes its planar part: {parts[0]}"
        )
    if columns is not None:
        path = urdf.path(best.tip)
        idle = [j.name for j in usable if j in path and j.name not in columns]
        if idle:
            notes.append(
                f"locked because the log has no columns for them: {listed(idle)}"
            )
    return best, notes


def _named(
    urdf: Urdf,
    posture: Posture,
    names: Sequence[str],
    tip: str | None,
    free: Sequence[Joint],
) -> Chain:
    """Return the arm of the joints that a user named, all of them `free` ones."""
    joints = [_movable(urdf, name, "joints") for name in names]
    if tip is None and joints:
        last = max(joints, key=lambda joint: len(urdf.path(joint.child)))
        tip = find_tip(urdf, last.child)
    path = urdf.path(tip or "")
    moving = [joint for joint in free if joint in path]
    active = [joint for joint in joints if joint in moving]
    chains = find_chains(urdf, posture, active, tip)
    if chains and sorted(j.name for j in chains[0].joints) == sorted(names):
        return chains[0]
    raise OptionError(
        f"`joints` are {listed(map(quoted, names))}: expected two or more of those that move "
        f"the tip {quoted(tip or '')} on their own, each once: "
        f"{listed(quoted(joint.name) for joint in moving)}",
        parameter="joints",
        value=list(names),
    )


def _movable(urdf: Urdf, name: str, parameter: str) -> Joint:
    """Return the movable joint of a name, or say which there are."""
    joint = urdf.joint(name)
    if joint is None or not joint.movable:
        what = "does not exist" if joint is None else "is fixed"
        raise RobotError(
            f"`{parameter}`: joint {quoted(name)} {what}",
            hint=suggestion(name, [j.name for j in urdf.joints if j.movable]),
            parameter=parameter,
            value=name,
        )
    return joint


def _link(urdf: Urdf, tip: str) -> str:
    """Return the link of a frame's name: a link, or the child of a joint."""
    joint = urdf.joint(tip)
    if tip in urdf.links:
        return tip
    if joint is None:
        raise RobotError(
            f"`tip`: frame {quoted(tip)} does not exist",
            hint=suggestion(tip, urdf.links),
            parameter="tip",
            value=tip,
        )
    return joint.child


def _check_limits(joints: Sequence[Joint]) -> None:
    """Ask for `ranges` of all joints whose limits are unusable."""
    faulty = [joint for joint in joints if joint.fault]
    if faulty:
        faults = "; ".join(
            f"joint {j.name!r} cannot be babbled, {j.fault}" for j in faulty
        )
        wanted = ", ".join(f"{j.name!r}: (LOWER, UPPER)" for j in faulty)
        units = ", ".join(sorted({joint.unit for joint in faulty}))
        raise RobotError(
            faults,
            hint=f"give `ranges={{{wanted}}}` [{units}]",
            parameter="ranges",
        )
