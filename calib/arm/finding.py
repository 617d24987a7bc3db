"""Finding: the joints and the tip of an arm for users who name none, and its planar part.

The arm is the chain that reaches furthest.  It ends before its hand: at a link that branches, where
a branch is short compared with the way from the first joint to that link.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..common.arrays import Array
from ..common.rows import row_lengths
from ..common.wording import listing, quoted, vector
from ..errors import RobotError
from .posture import Posture
from .urdf import Joint, Urdf


@dataclass(frozen=True)
class FindingSettings:
    """What makes joints an arm; shares and lengths were chosen on the robots of docs/robots.md."""

    # of an arm in space, as many as a log can cover: of more those nearest to the root are locked
    most_joints: int = 7
    most_in_plane: int = 3  # joints of a planar part
    # share of a planar part's reach that each of its links has at least
    least_share: float = 0.05
    # share of the way from the first joint to a branching link: a shorter branch is a hand
    hand: float = 0.35
    giant: float = 30.0  # [m], no arm's links are as long together
    # share of the reach by which chains of one reach differ at most
    alike: float = 0.01
    # [rad], axes that are closer count as parallel, or across
    parallel: float = 1e-4
    # [m], a tip nearer to the last axis is not moved by it
    least_lever: float = 1e-6


FINDING = FindingSettings()

TIP_NAMES = (
    "tool0",
    "tcp",
    "tool",
    "tip",
    "ee_link",
    "ee",
    "end_effector",
    "gripper_frame_link",
)
"""Usual names (their ends) of the frame that a robot's maker means by its tip."""


@dataclass(frozen=True)
class JointChoice:
    """Some joints on the way to a tip, base to tip, and how far they reach [m]."""

    joints: tuple[Joint, ...]
    tip: str
    reach: float

    def __str__(self) -> str:
        return f"`joints={[joint.name for joint in self.joints]}` `tip={self.tip!r}`"


def furthest_choices(
    urdf: Urdf, posture: Posture, free: Sequence[Joint], tip: str | None
) -> list[JointChoice]:
    """Choices of at least two free joints that reach furthest, several where they reach alike.

    tip : the link at their end; None for any
    """
    tips = [tip] if tip else []
    if tip is None:
        tips = sorted({_arm_tip(urdf, posture, joint) for joint in free})
    choices: list[JointChoice] = []
    for end in tips:
        joints = tuple(joint for joint in urdf.path(end) if joint in free)
        if len(joints) > 1:
            reach = _reach(joints, end, posture)
            choices.append(JointChoice(joints, end, reach))
    choices.sort(key=lambda choice: (-round(choice.reach, 6), str(choice)))
    alike: dict[tuple[Joint, ...], JointChoice] = {}
    for choice in choices:
        far = choice.reach >= (1 - FINDING.alike) * choices[0].reach
        if far and len(choice.joints) == len(choices[0].joints):
            alike.setdefault(choice.joints, choice)
    return list(alike.values())


def find_tip(urdf: Urdf, link: str) -> str:
    """Return the tip that a link leads to: a leaf, or the link where its way outwards branches.

    At a branching, a child with a tool's usual name (tool0, tcp, ...) is followed, or else
    the only child that carries further joints (its siblings are sensors and covers).
    """
    while below := urdf.below(link):
        if len(below) > 1:
            tools = [
                joint
                for name in TIP_NAMES
                for joint in below
                if joint.child.lower().endswith(name)
            ]
            branches = [
                joint
                for joint in below
                if joint.movable or urdf.carries(joint.child)
            ]
            below = tuple(tools[:1] or branches)
        if len(below) != 1:
            break
        link = below[0].child
    return link


def plane_normal(joints: Sequence[Joint], posture: Posture) -> Array | None:
    """Unit normal (3,) of the plane in which all joints move, None of an arm in space.

    Raises RobotError if they all slide along one line.
    """
    normal, within = _common_plane(joints, posture)
    if len(within) < len(joints):
        return None
    # antiparallel axes are one direction; against the mean of all each joint's tilt is small
    axes = [posture.axis(joint) for joint in joints if joint.revolute]
    aligned = [axis * np.sign(axis @ normal) for axis in axes] or [normal]
    return np.asarray(np.mean(aligned, axis=0))


def check_planar(joints: Sequence[Joint], posture: Posture) -> None:
    """Refuse joints that do not all move in one plane."""
    normal, within = _common_plane(joints, posture)
    for joint in joints:
        if joint not in within:
            axis = vector(posture.axis(joint))
            expected = "parallel" if joint.revolute else "perpendicular"
            raise RobotError(
                f"the arm is not planar: joint {quoted(joint.name)} has the axis {axis} in the "
                f"root frame, expected one {expected} to the others' normal {vector(normal)}",
                hint="choose other `joints`, or leave out `planar`",
                parameter="joints",
            )


def _common_plane(
    joints: Sequence[Joint], posture: Posture
) -> tuple[Array, list[Joint]]:
    """Return the unit normal (3,) that most joints share, and the joints that move in its plane.

    Raises RobotError if they all slide along one line.
    """
    planes = list(_planes(joints, posture))
    if not planes:
        axis = vector(posture.axis(joints[0]))
        raise RobotError(
            f"joints {listing(joint.name for joint in joints)} all slide along {axis}: they move "
            "the tip along a line, not over a plane"
        )
    # the first of them where several tie
    return max(planes, key=lambda plane: len(plane[1]))


def planar_part(choice: JointChoice, posture: Posture) -> JointChoice | None:
    """The joints of a choice that move its tip within one plane; None where fewer than two do.

    Of several planes the one with the most joints, of as many the one with the furthest reach.
    """
    planar: list[JointChoice] = []
    for normal, joints in _planes(choice.joints, posture):
        part = _with_long_links(joints, choice.tip, normal, posture)
        if part is not None:
            planar.append(part)
    return max(
        planar,
        key=lambda choice: (len(choice.joints), round(choice.reach, 6)),
        default=None,
    )


def _with_long_links(
    joints: list[Joint], tip: str, normal: Array, posture: Posture
) -> JointChoice | None:
    """The joints of a plane, without that of the shortest link until they are few and links long.

    None where fewer than two are left.
    """
    while len(joints) > 1:
        links = _links(joints, tip, posture)
        flat = links - np.outer(links @ normal, normal)
        lengths = row_lengths(flat)
        lengths += [_slide_length(joint) for joint in joints]
        reach = float(lengths.sum())
        shortest = int(np.argmin(lengths))
        least = max(FINDING.least_share * reach, FINDING.least_lever)
        few = len(joints) <= FINDING.most_in_plane
        if few and lengths[shortest] >= least:
            return JointChoice(tuple(joints), tip, reach)
        joints = joints[:shortest] + joints[shortest + 1 :]
    return None


def check_tip(last: Joint, tip: str, posture: Posture) -> None:
    """Refuse a tip on the axis of the last turning joint: that joint would not move it."""
    to_tip = posture.place(tip) - posture.place(last.child)
    lever = np.linalg.norm(np.cross(posture.axis(last), to_tip))
    if last.revolute and lever < FINDING.least_lever:
        raise RobotError(
            f"joint {quoted(last.name)} does not move the tip {quoted(tip)}, which lies on its "
            "axis: leave the joint out, choose another tip, or add a tip link on a fixed joint to "
            "the URDF"
        )


def _planes(
    joints: Sequence[Joint], posture: Posture
) -> Iterator[tuple[Array, list[Joint]]]:
    """Yield unit normals (3,) of planes, each with the joints that move within its plane.

    A joint turns about a normal; two slides span a plane.
    """
    axes = np.array([posture.axis(joint) for joint in joints])
    turning = np.array([joint.revolute for joint in joints])
    normals = [*axes[turning]]
    for one, other in combinations(axes[~turning], 2):
        normal = np.cross(one, other)
        size = float(np.linalg.norm(normal))
        if size > FINDING.parallel:
            normals.append(normal / size)
    for normal in normals:
        # sines of the angles by which axes are off: along the normal, of slides across it
        sines = row_lengths(np.cross(axes, normal))
        off = np.where(turning, sines, np.abs(axes @ normal))
        within = np.flatnonzero(off <= FINDING.parallel)
        yield normal, [joints[k] for k in within.tolist()]


def _arm_tip(urdf: Urdf, posture: Posture, joint: Joint) -> str:
    """Return the tip that a joint leads to, or the link before the hand on the way to it."""
    tip = find_tip(urdf, joint.child)
    path = [other for other in urdf.path(tip) if other.movable]
    for k, other in enumerate(path[1:], start=1):
        end = find_tip(urdf, other.parent)
        if end != tip and other not in urdf.path(end):
            before = _reach(path[:k], other.parent, posture)
            beyond = _reach(path[k:], tip, posture)
            if beyond < FINDING.hand * before:
                return end
    return tip


def _reach(joints: Sequence[Joint], tip: str, posture: Posture) -> float:
    """Sum of the distances from joint to joint and to the tip, and of the slides' travel [m]."""
    lengths = row_lengths(_links(joints, tip, posture))
    return float(lengths.sum()) + sum(map(_slide_length, joints))


def _links(joints: Sequence[Joint], tip: str, posture: Posture) -> Array:
    """Vectors (n, 3) [m] from joint to joint and to the tip."""
    links = [*(joint.child for joint in joints), tip]
    return np.diff([posture.place(link) for link in links], axis=0)


def _slide_length(joint: Joint) -> float:
    """Travel of a sliding joint [m], 1 without limits; 0 of a turning one."""
    if joint.revolute:
        return 0.0
    lower, upper = joint.travel
    return upper - lower if np.isfinite(upper - lower) else 1.0
