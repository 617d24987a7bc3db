"""Finding: which joints and which tip, for users who named none: the arm that reaches furthest.

A chain from the root to a tip reaches as far as its joints' distances and slides add up to.
Fingers are no part of an arm: where a link branches and what lies beyond a joint of it is short
beside the way up to it, the arm ends before that joint.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..common.wording import listed, quoted
from ..errors import RobotError
from .candidates import (
    RIVAL,
    Candidate,
    alternatives,
    choose,
    find_candidates,
    find_tip,
    largest,
    nothing_found,
    rivals,
)
from .folding import followers
from .plane import PARALLEL, common_normal
from .posture import Posture
from .ranges import Range, fixed_by_limits, full_range, limits_fault
from .tree import Joint, Urdf

_Found = tuple[list[Joint], str, bool]


@dataclass(frozen=True)
class Choice:
    """What a user said of the arm that is wanted; see `load_arm`."""

    joints: Sequence[str] | None
    tip: str | None
    lock: Mapping[str, float]
    ranges: Mapping[str, Range]
    planar: bool
    columns: Collection[str] | None


def find_arm(urdf: Urdf, posture: Posture, choice: Choice) -> tuple[_Found, list[str]]:
    """Return active joints, tip and whether they are planar, and what to say about it.

    The chain that reaches furthest decides: if all of its joints move in one plane, the planar
    arms of the robot are compared by the area that they reach over.
    """
    fixed = {
        joint.name
        for joint in urdf.joints
        if fixed_by_limits(joint) and joint.name not in choice.ranges
    }
    excluded = fixed.union(choice.lock)
    idle: list[str] = []
    if choice.columns is not None:
        idle = [j.name for j in urdf.joints if j.movable and j.name not in choice.columns]
        excluded = excluded.union(idle)
    if choice.planar:
        return _planar(urdf, posture, choice, fixed, excluded)
    chains = _find_chains(urdf, posture, choice.tip, excluded)
    if not chains:
        explained = _no_chain(urdf, choice.tip, choice.lock, choice.columns)
        raise explained or nothing_found(urdf, posture, choice.tip, choice.lock, fixed)
    first = chains[0]
    if is_planar(urdf, posture, first.joints, first.tip) or in_line(first.joints, posture):
        return _planar(urdf, posture, choice, fixed, excluded)
    # a log was measured on one of them only; in simulation the first serves
    chosen, note = choose(
        chains, 1 - _EQUAL, "arms of one reach", strict=choice.columns is not None
    )
    notes = [note] if note else []
    unlogged = [joint.name for joint in urdf.path(chosen.tip) if joint.name in idle]
    if unlogged:
        notes.append(f"locked because the log has no columns for them: {listed(unlogged)}")
    planar = rivals(find_candidates(urdf, posture, choice.tip, excluded), RIVAL)
    if len(planar) == 1:
        notes.append(f"the arm moves in space; `planar=True` takes its planar part: {planar[0]}")
    return (list(chosen.joints), chosen.tip, False), notes


def is_planar(urdf: Urdf, posture: Posture, joints: Sequence[Joint], tip: str) -> bool:
    """Whether joints move a tip within one plane, and no mimic joint follows any of them."""
    try:
        common_normal(joints, posture)
    except RobotError:
        return False
    return not followers(urdf, urdf.path(tip), joints)


def in_line(joints: Sequence[Joint], posture: Posture) -> bool:
    """Whether joints do no more than slide along one line."""
    axes = np.array([posture.axes[joint.name] for joint in joints])
    slides = not any(joint.revolute for joint in joints)
    return slides and bool(np.linalg.norm(np.cross(axes, axes[0]), axis=1).max() < PARALLEL)


def _planar(
    urdf: Urdf, posture: Posture, choice: Choice, fixed: Collection[str], excluded: Collection[str]
) -> tuple[_Found, list[str]]:
    candidates = find_candidates(urdf, posture, choice.tip, excluded)
    if not candidates:
        raise nothing_found(urdf, posture, choice.tip, choice.lock, fixed)
    chosen, _ = choose(candidates, RIVAL, "planar arms")
    shown = alternatives(candidates[1:], 3)
    notes = [f"chosen by reach: {chosen} (others: {shown})"] if shown else []
    return (list(chosen.joints), chosen.tip, True), notes


#: More joints than this are no arm that a log could cover: those nearest to the root are held.
MOST_JOINTS = 7
#: What lies beyond a joint of a branching link is a finger if it is shorter than this share of
#: the way from the first joint up to it.
_FINGER = 0.35
#: Chains whose reach differs by less than this share are equals.
_EQUAL = 0.01
#: Last joints of these names open a hand and move no arm.
_FINGER_NAME = re.compile(r"(gripper|finger|jaw|claw|thumb)(_(left|right|joint|\d+))*$", re.I)


def _find_chains(
    urdf: Urdf, posture: Posture, tip: str | None, excluded: Collection[str]
) -> list[Candidate]:
    """Return the chains of two joints or more, the one that reaches furthest first.

    `posture` has all joints at their locked values; `excluded` are not to be used.
    """
    movable = [joint for joint in urdf.joints if joint.movable and not joint.mimic]
    tips = [tip] if tip else sorted({_arm_tip(urdf, posture, joint) for joint in movable})
    found: list[Candidate] = []
    for link in tips:
        usable = [j for j in urdf.path(link) if j in movable and j.name not in excluded]
        if len(usable) >= 2:
            reach = _reach(usable, link, posture)
            found.append(Candidate(tuple(usable[-MOST_JOINTS:]), link, reach))
    chains = largest(found)
    longer = [chain.names for chain in chains]
    return [
        chain
        for chain in chains
        if not any(other[: len(chain.names)] == chain.names != other for other in longer)
    ]


def _no_chain(
    urdf: Urdf, tip: str | None, locked: Collection[str], columns: Collection[str] | None
) -> RobotError | None:
    """Explain that no two joints of a chain are among a log's columns, or None."""
    if columns is None:
        return None
    joints = [joint for joint in (urdf.path(tip) if tip else urdf.joints) if joint.movable]
    named = [joint.name for joint in joints if joint.name in columns and joint.name not in locked]
    to_tip = f" to {quoted(tip)}" if tip else ""
    return RobotError(
        f"an arm needs at least two joints of one chain{to_tip}; joints among the log's columns: "
        f"{listed(named)}; the robot's joints: "
        f"{listed(joint.name for joint in joints)}",
        hint="if columns have other names, give `columns={'JOINT': 'COLUMN'}`",
        parameter="columns",
        value=list(named),
    )


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
    for joint in joints:
        if not joint.revolute and not limits_fault(joint):
            lower, upper = full_range(joint)
            reach += upper - lower
    return reach
