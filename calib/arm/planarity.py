"""Planarity: whether joints move a tip within one plane, and which joint does not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..common.wording import listed, quoted
from ..errors import RobotError
from .posture import Posture
from .tree import Joint, Urdf

Array = NDArray[np.float64]

#: Two axes closer than this [rad] count as parallel (or across each other).
PARALLEL = 1e-4
#: A tip nearer than this [m] to the last joint's axis is not moved by it.
MIN_LEVER = 1e-6


def fits(joint: Joint, axis: Array, normal: Array) -> bool:
    """Whether a joint moves within the plane across a normal."""
    if joint.revolute:
        return bool(np.linalg.norm(np.cross(axis, normal)) <= PARALLEL)
    return bool(abs(axis @ normal) <= PARALLEL)


def common_normal(active: Sequence[Joint], posture: Posture) -> Array:
    """Return the direction all active joints agree on, or name the one that does not."""
    axes = {joint.name: posture.axes[joint.name] for joint in active}
    turning = [axes[joint.name] for joint in active if joint.revolute]
    if turning:
        # The direction that most joints share; the first of them where several tie.
        votes = [sum(fits(joint, axes[joint.name], axis) for joint in active) for axis in turning]
        normal = turning[int(np.argmax(votes))]
    else:
        crossed = [np.cross(axis, axes[active[0].name]) for axis in axes.values()]
        normal = max(crossed, key=lambda vector: float(np.linalg.norm(vector)))
        length = float(np.linalg.norm(normal))
        if length < PARALLEL:
            raise RobotError(
                f"joints {listed(axes)} all slide along {_shown(axes[active[0].name])}: "
                "they move the tip along a line, not over a plane"
            )
        normal = normal / length
    for joint in active:
        axis = axes[joint.name]
        if not fits(joint, axis, normal):
            wanted = "parallel to" if joint.revolute else "perpendicular to"
            raise RobotError(
                f"the arm is not planar: joint {quoted(joint.name)} has the axis {_shown(axis)} "
                f"in the root frame, expected one {wanted} the others' normal {_shown(normal)}",
                hint="choose other `joints`",
                parameter="joints",
            )
    # antiparallel axes are one direction; the mean keeps a joint's own tilt small
    aligned = [axis if axis @ normal > 0 else -axis for axis in turning]
    return np.mean(aligned, axis=0) if aligned else normal


def frames_moved(joint: Joint, urdf: Urdf, posture: Posture) -> list[str]:
    """Links beyond a joint whose origins it moves."""
    axis, point = posture.axes[joint.name], posture.points[joint.name]
    return [
        link
        for link in urdf.links
        if joint in urdf.path(link)
        and not (
            joint.revolute
            and float(np.linalg.norm(np.cross(axis, posture.links[link] - point))) < MIN_LEVER
        )
    ]


def check_tip(last: Joint, tip: str, urdf: Urdf, posture: Posture) -> None:
    """Refuse a tip on the axis of the last turning joint: that joint would not move it."""
    moved = frames_moved(last, urdf, posture)
    if tip not in moved:
        remedy = (
            f"choose a tip off the axis from {listed(moved)}"
            if moved
            else "add a tip link on a fixed joint to the URDF"
        )
        raise RobotError(
            f"joint {quoted(last.name)} does not move the tip {quoted(tip)}, which lies on its "
            f"axis: leave the joint out or {remedy}"
        )


def _shown(vector: Array) -> str:
    return "(" + ", ".join(f"{value + 0.0:.4g}" for value in np.round(vector, 6)) + ")"
