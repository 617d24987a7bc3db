"""Choice: the joints and the tip of an arm, as a user names them or by the furthest reach."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from ..common.wording import listing, quoted, suggestion
from ..errors import OptionError, RobotError
from .finding import (
    FINDING,
    TIP_NAMES,
    JointChoice,
    find_tip,
    furthest_choices,
    planar_part,
    plane_normal,
)
from .posture import Posture
from .urdf import Joint, Urdf


def check_lock(urdf: Urdf, lock: Collection[str]) -> None:
    """Refuse to lock joints that do not exist or are fixed."""
    for name in lock:
        _movable(urdf, name, "lock")


def choose_joints(
    urdf: Urdf,
    posture: Posture,
    *,
    joints: Sequence[str] | None,
    tip: str | None,
    lock: Mapping[str, float],
    ranges: Collection[str],
    planar: bool,
    columns: Collection[str] | None,
) -> tuple[JointChoice, list[str]]:
    """Return the joints of an arm, and notes on what was chosen for the user.

    joints, tip : as the user names them; None where calib chooses
    lock : values [rad or m] of joints that do not move
    ranges : joints with a range of the user's, which need no limits
    planar : whether only joints that move the tip within one plane are chosen
    columns : columns of a log, which names the joints that moved
    """
    link = None if tip is None else _link(urdf, tip)
    # joints that move on their own
    free = [
        joint
        for joint in urdf.joints
        if joint.movable and not joint.mimic and joint.name not in lock
    ]
    notes: list[str] = []
    if joints is None:
        with_room = [j for j in free if j.name in ranges or not j.stuck]
        choice, notes = _furthest_arm(
            urdf, posture, with_room, link, planar, columns
        )
    else:
        if isinstance(joints, str):
            joints = re.split(r"\s*,\s*", joints.strip())
        choice = _named_joints(urdf, posture, joints, link, free)
    if link is None and not choice.tip.lower().endswith(TIP_NAMES):
        notes.append(f"tip {quoted(choice.tip)} was chosen (`tip` changes it)")
    return choice, notes


def check_limits(joints: Sequence[Joint]) -> None:
    """Refuse joints whose limits are unusable, and ask for their `ranges`."""
    faulty = [joint for joint in joints if joint.fault]
    if faulty:
        faults = "; ".join(
            f"joint {j.name!r} cannot be babbled, {j.fault}" for j in faulty
        )
        ranges = ", ".join(f"{j.name!r}: (LOWER, UPPER)" for j in faulty)
        units = ", ".join(sorted({joint.unit for joint in faulty}))
        raise RobotError(
            faults,
            hint=f"give `ranges={{{ranges}}}` [{units}]",
            parameter="ranges",
        )


def _furthest_arm(
    urdf: Urdf,
    posture: Posture,
    free: Sequence[Joint],
    tip: str | None,
    planar: bool,
    columns: Collection[str] | None,
) -> tuple[JointChoice, list[str]]:
    """Return the arm for users who named no joints, and notes.

    free : joints that move on their own and have room to
    """
    measured = [j for j in free if columns is None or j.name in columns]
    choices = furthest_choices(urdf, posture, measured, tip)
    if not choices:
        raise _no_arm(urdf, measured, tip, columns)
    in_space = plane_normal(choices[0].joints, posture) is None
    arms = [
        _within_most_joints(choice, posture, planar or not in_space)
        for choice in choices
    ]
    arm = arms[0]
    others = "; ".join(map(str, arms[1:]))
    # a log was measured on one of them only; in simulation the first serves
    if others and columns is not None:
        raise RobotError(
            f"the robot has {len(arms)} arms of one reach, choose one: {arm}; {others}"
        )
    notes: list[str] = []
    if others:
        notes.append(f"chosen by reach: {arm} (others: {others})")
    planar_arm = planar_part(choices[0], posture)
    if planar_arm and in_space and not planar:
        notes.append(
            f"the arm moves in space; `planar=True` takes its planar part: {planar_arm}"
        )
    path = urdf.path(arm.tip)
    unmeasured = [j.name for j in free if j in path and j not in measured]
    if unmeasured:
        notes.append(
            f"locked because the log has no columns for them: {listing(unmeasured)}"
        )
    return arm, notes


def _within_most_joints(
    choice: JointChoice, posture: Posture, planar: bool
) -> JointChoice:
    """Return the joints of a choice that are learned: in a plane its planar part, if it has one."""
    if planar:
        return planar_part(choice, posture) or choice
    return replace(choice, joints=choice.joints[-FINDING.most_joints :])


def _no_arm(
    urdf: Urdf,
    free: Sequence[Joint],
    tip: str | None,
    columns: Collection[str] | None,
) -> RobotError:
    """Return why free joints make no arm; raise where unusable limits are the reason."""
    stuck = [j for j in urdf.joints if j.stuck and j not in free]
    if len(free) + len(stuck) > 1:
        check_limits(stuck)
    hint = "name other `joints`, `tip` or `lock`"
    what = "are free"
    if columns is not None:
        hint = "if columns have other names, give `columns={'JOINT': 'COLUMN'}`"
        what = "are free and columns of the log"
    movable = listing(joint.name for joint in urdf.joints if joint.movable)
    return RobotError(
        f"no arm{f' to {quoted(tip)}' if tip else ''}: it needs two joints in one chain; of "
        f"the movable joints {movable} these {what}: {listing(j.name for j in free)}",
        hint=hint,
    )


def _named_joints(
    urdf: Urdf,
    posture: Posture,
    names: Sequence[str],
    tip: str | None,
    free: Sequence[Joint],
) -> JointChoice:
    """Return the joints that a user names, or refuse them.

    free : joints that move on their own
    """
    joints = [_movable(urdf, name, "joints") for name in names]
    if tip is None and joints:
        last = max(joints, key=lambda joint: len(urdf.path(joint.child)))
        tip = find_tip(urdf, last.child)
    path = urdf.path(tip or "")
    moving = [joint for joint in free if joint in path]
    active = [joint for joint in joints if joint in moving]
    choices = furthest_choices(urdf, posture, active, tip)
    if choices and sorted(j.name for j in choices[0].joints) == sorted(names):
        return choices[0]
    raise OptionError(
        f"`joints` are {listing(map(quoted, names))}: expected two or more of those that move "
        f"the tip {quoted(tip or '')} on their own, each once: "
        f"{listing(quoted(joint.name) for joint in moving)}",
        parameter="joints",
        value=list(names),
    )


def _movable(urdf: Urdf, name: str, parameter: str) -> Joint:
    """Return the movable joint of a name, or refuse it and list those that exist."""
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
    """Return the link of a frame that is named by its link or by the joint that carries it."""
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
