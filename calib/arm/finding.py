"""Finding: which joints and which tip, for users who named none: the chain that reaches furthest.

It ends before its hand: where a link branches and what lies beyond a joint of it is short beside
the way up to it.  And which of its joints move a tip within one plane.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..common.arrays import Array
from ..common.wording import listing, quoted, vector
from ..errors import RobotError
from .posture import Posture
from .urdf import Joint, Urdf


@dataclass(frozen=True)
class Finding:
    """What makes joints an arm; shares and lengths were chosen on the robots of docs/robots.md."""

    # that a log could cover: those nearest to the root are held
    most_joints: int = 7
    most_in_plane: int = 3  # joints of a planar part
    least_share: float = 0.05  # of its reach, that the link of each joint has
    # of the way from the first joint up to a branching link: what is shorter beyond is a hand
    hand: float = 0.35
    # share of the reach by which chains of one reach differ
    alike: float = 0.01
    # [rad], axes that are closer count as parallel, or across
    parallel: float = 1e-4
    # [m], a tip nearer to the last axis is not moved by it
    least_lever: float = 1e-6


FINDING = Finding()

#: Usual names (their ends) of the frame that a robot's maker means by its tip.
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


@dataclass(frozen=True)
class Chain:
    """An arm within a robot: joints from base to tip, and how far it reaches [m]."""

    joints: tuple[Joint, ...]
    tip: str
    reach: float

    def __str__(self) -> str:
        return f"`joints={[joint.name for joint in self.joints]}` `tip={self.tip!r}`"


def find_chains(
    urdf: Urdf, posture: Posture, free: Sequence[Joint], tip: str | None
) -> list[Chain]:
    """Chains of two free joints or more that reach alike and furthest, the furthest first."""
    tips = [tip] if tip else []
    if tip is None:
        tips = sorted({_arm_tip(urdf, posture, joint) for joint in free})
    chains: list[Chain] = []
    for end in tips:
        path = tuple(joint for joint in urdf.path(end) if joint in free)
        if len(path) > 1:
            chains.append(Chain(path, end, _reach(path, end, posture)))
    chains.sort(key=lambda chain: (-round(chain.reach, 6), str(chain)))
    alike: dict[tuple[Joint, ...], Chain] = {}
    for chain in chains:
        near = chain.reach >= (1 - FINDING.alike) * chains[0].reach
        if near and len(chain.joints) == len(chains[0].joints):
            alike.setdefault(chain.joints, chain)
    return list(alike.values())


def find_tip(urdf: Urdf, link: str) -> str:
    """Follow a link outwards to the tip it leads to: a leaf, or where it branches.

    At a branching, a child with a tool's usual name (tool0, tcp, ...) is followed, or else
    the only child that carries further joints (its siblings are sensors and covers).
    """
    while below := urdf.below(link):
        if len(below) > 1:
            named = [
                joint
                for name in TIP_NAMES
                for joint in below
                if joint.child.lower().endswith(name)
            ]
            carrying = [
                joint
                for joint in below
                if joint.movable or urdf.carries(joint.child)
            ]
            below = tuple(named[:1] or carrying)
        if len(below) != 1:
            break
        link = below[0].child
    return link


def plane_normal(
    joints: Sequence[Joint], posture: Posture, *, wanted: bool = False
) -> Array | None:
    """Direction (3,) across the plane in which all joints move, None of an arm in space.

    Raises RobotError if they move along a line, or a planar arm is `wanted` and they are none
    """
    axes = [posture.axis(joint) for joint in joints]
    planes = list(_planes(joints, posture))
    if not planes:
        raise RobotError(
            f"joints {listing(joint.name for joint in joints)} all slide along {vector(axes[0])}: "
            "they move the tip along a line, not over a plane"
        )
    # the direction that most joints share; the first of them where several tie
    normal, within = max(planes, key=lambda plane: len(plane[1]))
    for joint, axis in zip(joints, axes, strict=True):
        if joint not in within:
            if not wanted:
                return None
            way = "parallel to" if joint.revolute else "perpendicular to"
            raise RobotError(
                f"the arm is not planar: joint {quoted(joint.name)} has the axis {vector(axis)} "
                f"in the root frame, expected one {way} the others' normal {vector(normal)}",
                hint="choose other `joints`, or leave out `planar`",
                parameter="joints",
            )
    # antiparallel axes are one direction; the mean keeps a joint's own tilt small
    turning = [
        axis for joint, axis in zip(joints, axes, strict=True) if joint.revolute
    ]
    aligned = [axis * np.sign(axis @ normal) for axis in turning] or [normal]
    return np.asarray(np.mean(aligned, axis=0))


def planar_part(chain: Chain, posture: Posture) -> Chain | None:
    """The joints of a chain, most and then furthest, that move its tip within one plane."""
    parts: list[Chain] = []
    for normal, members in _planes(chain.joints, posture):
        within = members
        # joints that hardly move the tip are left out, and too many
        while len(within) > 1:
            links = _links(within, chain.tip, posture)
            flat = links - np.outer(links @ normal, normal)
            levers = np.linalg.norm(flat, axis=1)
            levers += [_slid(joint) for joint in within]
            reach = float(levers.sum())
            weakest = int(np.argmin(levers))
            least = max(FINDING.least_share * reach, FINDING.least_lever)
            if (
                levers[weakest] >= least
                and len(within) <= FINDING.most_in_plane
            ):
                parts.append(Chain(tuple(within), chain.tip, reach))
                break
            within = within[:weakest] + within[weakest + 1 :]
    return max(
        parts,
        key=lambda part: (len(part.joints), round(part.reach, 6)),
        default=None,
    )


def check_tip(last: Joint, tip: str, posture: Posture) -> None:
    """Refuse a tip on the axis of the last turning joint: that joint would not move it."""
    arm = posture.place(tip) - posture.place(last.child)
    if (
        last.revolute
        and np.linalg.norm(np.cross(posture.axis(last), arm))
        < FINDING.least_lever
    ):
        raise RobotError(
            f"joint {quoted(last.name)} does not move the tip {quoted(tip)}, which lies on its "
            "axis: leave the joint out, choose another tip, or add a tip link on a fixed joint to "
            "the URDF"
        )


def _planes(
    joints: Sequence[Joint], posture: Posture
) -> Iterator[tuple[Array, list[Joint]]]:
    """Normals (3,) of the planes that axes span, with the joints that move within each."""
    axes = np.array([posture.axis(joint) for joint in joints])
    turning = np.array([joint.revolute for joint in joints])
    normals = [*axes[turning]]
    for one, other in combinations(axes[~turning], 2):
        normal = np.cross(one, other)
        size = float(np.linalg.norm(normal))
        if size > FINDING.parallel:
            normals.append(normal / size)
    for normal in normals:
        off = np.linalg.norm(np.cross(axes, normal), axis=1)
        off = np.where(turning, off, np.abs(axes @ normal))
        within = np.flatnonzero(off <= FINDING.parallel)
        yield normal, [joints[k] for k in within.tolist()]


def _arm_tip(urdf: Urdf, posture: Posture, joint: Joint) -> str:
    """Follow a joint outwards to the tip it leads to, and back to before a hand."""
    tip = find_tip(urdf, joint.child)
    path = [other for other in urdf.path(tip) if other.movable]
    for k, other in enumerate(path[1:], start=1):
        end = find_tip(urdf, other.parent)
        if end != tip and other not in urdf.path(end):
            before = _reach(path[:k], other.parent, posture)
            if _reach(path[k:], tip, posture) < FINDING.hand * before:
                return end
    return tip


def _reach(joints: Sequence[Joint], tip: str, posture: Posture) -> float:
    """Distances from joint to joint and to the tip, and the travel of slides [m]."""
    lengths = np.linalg.norm(_links(joints, tip, posture), axis=1)
    return float(lengths.sum()) + sum(map(_slid, joints))


def _links(joints: Sequence[Joint], tip: str, posture: Posture) -> Array:
    """Vectors (n, 3) [m] from joint to joint and to the tip."""
    links = [*(joint.child for joint in joints), tip]
    return np.diff([posture.place(link) for link in links], axis=0)


def _slid(joint: Joint) -> float:
    """How far a joint slides [m]; 1 where its limits do not say."""
    if joint.revolute:
        return 0.0
    lower, upper = joint.travel
    return upper - lower if np.isfinite(upper - lower) else 1.0
