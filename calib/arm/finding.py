"""Finding: which joints and which tip, for users who named none: the arm that reaches furthest.

A chain from the root to a tip reaches as far as its joints' distances and slides add up to.
Fingers are no part of it: where a link branches and what lies beyond a joint of it is short beside
the way up to it, the arm ends before that joint.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..common.arrays import Array
from ..common.wording import listed, quoted
from ..errors import RobotError
from .plane import MIN_LEVER, PARALLEL, check_tip, common_normal, fits
from .posture import Posture, followers
from .ranges import Range, fixed_by_limits, limits_fault, ranges_wanted, travel
from .urdf import Joint, Urdf

#: More joints than this are no arm that a log could cover: those nearest to the root are held.
MOST_JOINTS = 7
#: So many of a planar part, and none whose link is shorter than this share of its reach.
_MOST_IN_PLANE, _MIN_SHARE = 3, 0.05
#: What lies beyond a joint of a branching link is a finger if it is shorter than this share of
#: the way from the first joint up to it; so is what has such a name.
_FINGER = 0.35
_FINGER_NAME = re.compile(r"(gripper|finger|jaw|claw|thumb)(_(left|right|joint|\d+))*$", re.I)
#: Chains whose reach differs by less than this share are equals.
_EQUAL = 0.01
#: Usual names (their ends) of the frame that a robot's maker means by its tip.
_TIP_NAMES = ("tool0", "tcp", "tool", "tip", "ee_link", "ee", "end_effector", "gripper_frame_link")


@dataclass(frozen=True)
class Choice:
    """What a user said of the arm that is wanted; see `load_arm`."""

    joints: Sequence[str] | None
    tip: str | None
    lock: Mapping[str, float]
    ranges: Mapping[str, Range]
    planar: bool
    columns: Collection[str] | None


@dataclass(frozen=True)
class _Chain:
    """An arm within a robot: joints from base to tip, and how far it reaches [m]."""

    joints: tuple[Joint, ...]
    tip: str
    reach: float

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    def __str__(self) -> str:
        return f"`joints={list(self.names)}` `tip={self.tip!r}`"


def find_arm(
    urdf: Urdf, posture: Posture, choice: Choice
) -> tuple[tuple[list[Joint], str, bool], list[str]]:
    """Return active joints, tip and whether they are planar, and what to say about it."""
    movable = [joint for joint in urdf.joints if joint.movable]
    logged = {joint.name for joint in movable} if choice.columns is None else set(choice.columns)
    stuck = {joint.name for joint in movable if fixed_by_limits(joint)}
    excluded = stuck.difference(choice.ranges).union(choice.lock)
    tips = (
        [choice.tip]
        if choice.tip
        else sorted({_arm_tip(urdf, posture, joint) for joint in movable if not joint.mimic})
    )
    paths = [
        ([j for j in urdf.path(tip) if j in movable and not j.mimic
          and j.name in logged and j.name not in excluded], tip)
        for tip in tips
    ]  # fmt: skip
    whole = _furthest(
        _Chain(tuple(path[-MOST_JOINTS:]), tip, _reach(path, tip, posture))
        for path, tip in paths
        if len(path) >= 2
    )
    parts = _furthest(part for path, tip in paths for part in _planar_parts(path, tip, posture))
    planar = sorted(parts, key=lambda chain: -len(chain.joints))
    flat = choice.planar or bool(whole and is_flat(urdf, posture, whole[0].joints, whole[0].tip))
    found = planar if flat else whole
    if not found:
        raise _nothing(urdf, posture, choice, whole)
    best = found[0]
    like = [chain for chain in found if len(chain.joints) == len(best.joints)]
    equals = [chain for chain in like if chain.reach >= (1 - _EQUAL) * best.reach]
    # a log was measured on one of them only; in simulation the first serves
    if len(equals) > 1 and choice.columns is not None:
        raise RobotError(
            f"the robot has {len(equals)} arms of one reach, choose one: {_of(equals)}"
        )
    notes = []
    if len(equals) > 1 or (flat and len(found) > 1):
        others = equals if len(equals) > 1 else found
        notes.append(f"chosen by reach: {best} (others: {_of(others[1:])})")
    if idle := [j.name for j in urdf.path(best.tip) if j.movable and j.name not in logged]:
        notes.append(f"locked because the log has no columns for them: {listed(idle)}")
    if not flat and planar:
        notes.append(f"the arm moves in space; `planar=True` takes its planar part: {planar[0]}")
    return (list(best.joints), best.tip, flat), notes


def find_tip(urdf: Urdf, link: str) -> str:
    """Follow a link outwards to the tip it leads to: a leaf, or where it branches.

    At a branching, a child with a tool's usual name (tool0, tcp, ...) is followed, or else
    the only child that carries further joints (its siblings are sensors and covers).
    """
    while True:
        below = urdf.below(link)
        if len(below) > 1:
            below = _named_tip(below) or tuple(
                joint for joint in below if joint.movable or urdf.carries(joint.child)
            )
        if len(below) != 1:
            return link
        link = below[0].child


def is_flat(urdf: Urdf, posture: Posture, joints: Sequence[Joint], tip: str) -> bool:
    """Whether joints move a tip within one plane, or along a line; no mimic joint follows any."""
    axes = np.array([posture.axes[joint.name] for joint in joints])
    slides = not any(joint.revolute for joint in joints)
    if slides and np.linalg.norm(np.cross(axes, axes[0]), axis=1).max() < PARALLEL:
        return True
    try:
        common_normal(joints, posture)
    except RobotError:
        return False
    return not followers(urdf, urdf.path(tip), joints)


def _of(chains: Sequence[_Chain], most: int = 6) -> str:
    """The options that name each chain, the first `most` of them."""
    return "; ".join(map(str, chains[:most])) + ("; ..." if len(chains) > most else "")


def _named_tip(joints: Sequence[Joint]) -> tuple[Joint, ...]:
    for name in _TIP_NAMES:
        named = tuple(joint for joint in joints if joint.child.lower().endswith(name))
        if named:
            return named if len(named) == 1 else ()
    return ()


def _furthest(chains: Iterable[_Chain]) -> list[_Chain]:
    """The furthest chain of each set of joints that is no part of another, the best first."""
    best: dict[tuple[str, ...], _Chain] = {}
    for chain in chains:
        if chain.names not in best or best[chain.names].reach < chain.reach:
            best[chain.names] = chain
    ordered = sorted(best.values(), key=lambda chain: (-round(chain.reach, 6), str(chain)))
    return [c for c in ordered if not any(o[: len(c.names)] == c.names != o for o in best)]


def _planar_parts(path: list[Joint], tip: str, posture: Posture) -> Iterable[_Chain]:
    """Joints of a path that move its tip within one plane."""
    slides = [posture.axes[joint.name] for joint in path if not joint.revolute]
    crossed = [np.cross(one, other) for one, other in combinations(slides, 2)]
    normals = [posture.axes[joint.name] for joint in path if joint.revolute]
    normals += [n / np.linalg.norm(n) for n in crossed if np.linalg.norm(n) > PARALLEL]
    for normal in normals:
        members = [joint for joint in path if fits(joint, posture.axes[joint.name], normal)]
        if (chain := _trimmed(members, normal, tip, posture)) is not None:
            yield chain


def _trimmed(members: list[Joint], normal: Array, tip: str, posture: Posture) -> _Chain | None:
    """Leave out joints that hardly move the tip, and more than `_MOST_IN_PLANE`."""
    while len(members) >= 2:
        stops = [*(posture.points[joint.name] for joint in members), posture.links[tip]]
        vectors = np.diff(np.array(stops), axis=0)
        levers = np.linalg.norm(vectors - np.outer(vectors @ normal, normal), axis=1)
        levers = levers + [_travel(joint) for joint in members]
        weakest = int(np.argmin(levers))
        small = levers[weakest] < max(_MIN_SHARE * levers.sum(), MIN_LEVER)
        if not small and len(members) <= _MOST_IN_PLANE:
            return _Chain(tuple(members), tip, float(levers.sum()))
        members = members[:weakest] + members[weakest + 1 :]
    return None


def _arm_tip(urdf: Urdf, posture: Posture, joint: Joint) -> str:
    """Follow a joint outwards to the tip it leads to, and back to before its fingers."""
    tip = find_tip(urdf, joint.child)
    path = [other for other in urdf.path(tip) if other.movable]
    while len(path) > 2 and _FINGER_NAME.search(path[-1].name):
        tip = find_tip(urdf, path[-1].parent)
        tip = path[-1].parent if path[-1] in urdf.path(tip) else tip
        path = path[:-1]
    for k, other in enumerate(path[1:], start=1):
        end = find_tip(urdf, other.parent)
        if end != tip and other not in urdf.path(end):
            before = _reach(path[:k], other.parent, posture)
            if _reach(path[k:], tip, posture) < _FINGER * before:
                return end
    return tip


def _reach(joints: Sequence[Joint], tip: str, posture: Posture) -> float:
    """Distances from joint to joint and to the tip, and the travel of slides [m]."""
    stops = np.array([*(posture.points[joint.name] for joint in joints), posture.links[tip]])
    reach = float(np.linalg.norm(np.diff(stops, axis=0), axis=1).sum())
    return reach + sum(map(_travel, joints))


def _travel(joint: Joint) -> float:
    """How far a joint slides [m]; 1 where its limits do not say."""
    lower, upper = travel(joint)
    return 0.0 if joint.revolute else upper - lower if np.isfinite(upper - lower) else 1.0


def _nothing(urdf: Urdf, posture: Posture, choice: Choice, whole: Sequence[_Chain]) -> RobotError:
    """Explain that no joints of a robot make the arm that was asked for."""
    if whole:  # in a plane, and yet no planar arm: say of the last joint what is wrong with it
        try:
            common_normal(whole[0].joints, posture)
            check_tip(whole[0].joints[-1], whole[0].tip, urdf, posture)
        except RobotError as error:
            return error
    tip, lock, columns = choice.tip, choice.lock, choice.columns
    joints = [j for j in (urdf.path(tip) if tip else urdf.joints) if j.movable and not j.mimic]
    stuck = [j for j in joints if fixed_by_limits(j) and j.name not in (*choice.ranges, *lock)]
    held = f", of which {listed(lock)} is locked" if lock else ""
    faults = "".join(f"; {joint.name}: {limits_fault(joint)}" for joint in stuck)
    hint = f"give {ranges_wanted(stuck)}" if stuck else None
    if columns is not None:
        faults += (
            f"; among the log's columns: {listed(j.name for j in joints if j.name in columns)}"
        )
        hint = "if columns have other names, give `columns={'JOINT': 'COLUMN'}`"
    return RobotError(
        f"no planar arm{f' to {quoted(tip)}' if tip else ''}: it needs two movable joints in one "
        "chain and, as tip, a frame off the last one's axis; movable joints: "
        f"{listed(j.name for j in joints)}{held}{faults}",
        hint=hint,
        parameter="ranges" if stuck else "columns" if columns is not None else None,
    )
