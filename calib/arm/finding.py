"""Finding: which joints and which tip, for users who named none: the arm that reaches furthest.

A chain from the root to a tip reaches as far as its joints' distances and slides add up to.
Fingers are no part of an arm: where a link branches and what lies beyond a joint of it is short
beside the way up to it, the arm ends before that joint.
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
from .folding import followers
from .plane import MIN_LEVER, PARALLEL, check_tip, common_normal, fits
from .posture import Posture
from .ranges import Range, fixed_by_limits, limits_fault, ranges_wanted, travel
from .tree import Joint, Urdf

#: More joints than this are no arm that a log could cover: those nearest to the root are held.
MOST_JOINTS = 7
#: So many of a planar part, and none whose link is shorter than this share of its reach.
_MOST_IN_PLANE, _MIN_SHARE = 3, 0.05
#: What lies beyond a joint of a branching link is a finger if it is shorter than this share of
#: the way from the first joint up to it.
_FINGER = 0.35
#: Chains whose reach differs by less than this share are equals.
_EQUAL = 0.01
#: Last joints of these names open a hand and move no arm.
_FINGER_NAME = re.compile(r"(gripper|finger|jaw|claw|thumb)(_(left|right|joint|\d+))*$", re.I)
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
    named = {joint.name for joint in urdf.joints if fixed_by_limits(joint)}
    excluded = named.difference(choice.ranges).union(choice.lock)
    idle: list[str] = []
    if choice.columns is not None:
        idle = [j.name for j in urdf.joints if j.movable and j.name not in choice.columns]
        excluded = excluded.union(idle)
    whole = _chains(urdf, posture, choice.tip, excluded)
    flat = choice.planar or bool(whole and is_flat(urdf, posture, whole[0].joints, whole[0].tip))
    planar = _planar_parts(urdf, posture, choice.tip, excluded)
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
    if len(equals) > 1:
        notes.append(
            f"chosen, as the first of {len(equals)} arms of one reach: {best} (others: "
            f"{_of(equals[1:])})"
        )
    elif flat and len(found) > 1:
        notes.append(f"chosen by reach: {best} (others: {_of(found[1:])})")
    if unlogged := [joint.name for joint in urdf.path(best.tip) if joint.name in idle]:
        notes.append(f"locked because the log has no columns for them: {listed(unlogged)}")
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


def _paths(
    urdf: Urdf, posture: Posture, tip: str | None, excluded: Collection[str]
) -> Iterable[tuple[list[Joint], str]]:
    """The joints that may move on the way to each tip."""
    movable = [joint for joint in urdf.joints if joint.movable and not joint.mimic]
    for link in [tip] if tip else sorted({_arm_tip(urdf, posture, joint) for joint in movable}):
        yield [j for j in urdf.path(link) if j in movable and j.name not in excluded], link


def _furthest(chains: Iterable[_Chain]) -> list[_Chain]:
    """The furthest chain of each set of joints that is no part of another, the best first."""
    best: dict[tuple[str, ...], _Chain] = {}
    for chain in chains:
        if chain.names not in best or best[chain.names].reach < chain.reach:
            best[chain.names] = chain
    ordered = sorted(best.values(), key=lambda chain: (-round(chain.reach, 6), str(chain)))
    return [c for c in ordered if not any(o[: len(c.names)] == c.names != o for o in best)]


def _chains(
    urdf: Urdf, posture: Posture, tip: str | None, excluded: Collection[str]
) -> list[_Chain]:
    """Chains of two joints or more, the one that reaches furthest first."""
    return _furthest(
        _Chain(tuple(usable[-MOST_JOINTS:]), link, _reach(usable, link, posture))
        for usable, link in _paths(urdf, posture, tip, excluded)
        if len(usable) >= 2
    )


def _planar_parts(
    urdf: Urdf, posture: Posture, tip: str | None, excluded: Collection[str]
) -> list[_Chain]:
    """The same of joints that move a tip within one plane, those of most joints first."""
    found = []
    for usable, link in _paths(urdf, posture, tip, excluded):
        slides = [joint for joint in usable if not joint.revolute]
        normals = [posture.axes[joint.name] for joint in usable if joint.revolute]
        for one, other in combinations(slides, 2):
            across = np.cross(posture.axes[one.name], posture.axes[other.name])
            if (length := np.linalg.norm(across)) > PARALLEL:
                normals.append(across / length)
        for normal in normals:
            members = [joint for joint in usable if fits(joint, posture.axes[joint.name], normal)]
            if (chain := _trimmed(members, normal, link, posture)) is not None:
                found.append(chain)
    return sorted(_furthest(found), key=lambda chain: -len(chain.joints))


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
    if joint.revolute:
        return 0.0
    lower, upper = travel(joint)
    return upper - lower if np.isfinite(upper - lower) else 1.0


def _nothing(urdf: Urdf, posture: Posture, choice: Choice, whole: Sequence[_Chain]) -> RobotError:
    """Explain that no joints of a robot make the arm that was asked for."""
    tip, lock = choice.tip, choice.lock
    joints = [j for j in (urdf.path(tip) if tip else urdf.joints) if j.movable and not j.mimic]
    to_tip = f" to {quoted(tip)}" if tip else ""
    if whole:  # in a plane, and yet no planar arm: say of the last joint what is wrong with it
        try:
            common_normal(whole[0].joints, posture)
            check_tip(whole[0].joints[-1], whole[0].tip, urdf, posture)
        except RobotError as error:
            return error
    if choice.columns is not None:
        logged = [j.name for j in joints if j.name in choice.columns and j.name not in lock]
        return RobotError(
            f"an arm needs at least two joints of one chain{to_tip}; joints among the log's "
            f"columns: {listed(logged)}; the robot's joints: {listed(j.name for j in joints)}",
            hint="if columns have other names, give `columns={'JOINT': 'COLUMN'}`",
            parameter="columns",
            value=logged,
        )
    stuck = [j for j in joints if fixed_by_limits(j) and j.name not in (*choice.ranges, *lock)]
    held = f", of which {listed(lock)} is locked" if lock else ""
    faults = "".join(f"; {joint.name}: {limits_fault(joint)}" for joint in stuck)
    return RobotError(
        f"no planar arm{to_tip}: it needs two movable joints in one chain and, as tip, a frame "
        f"off the last one's axis; movable joints: {listed(j.name for j in joints)}{held}{faults}",
        hint=f"give {ranges_wanted(stuck)}" if stuck else None,
        parameter="ranges" if stuck else None,
    )
