"""Finding: which joints and which tip, for users who named none: planar or spatial."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..common.wording import listed
from ..errors import RobotError
from .candidates import Candidate, choose, find_candidates, nothing_found
from .choosing import choose_chain, find_chains, no_chain
from .folding import followers
from .planarity import PARALLEL, common_normal
from .posture import Posture
from .ranges import Range, fixed_by_limits
from .tree import Joint, Urdf

Found = tuple[list[Joint], str, bool]


@dataclass(frozen=True)
class Choice:
    """What a user said of the arm that is wanted; see `load_arm`."""

    joints: Sequence[str] | None
    tip: str | None
    lock: Mapping[str, float]
    ranges: Mapping[str, Range]
    planar: bool
    columns: Collection[str] | None


def find_arm(urdf: Urdf, posture: Posture, choice: Choice) -> tuple[Found, list[str]]:
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
    chains = find_chains(urdf, posture, choice.tip, excluded)
    if not chains:
        explained = no_chain(urdf, choice.tip, choice.lock, choice.columns)
        raise explained or nothing_found(urdf, posture, choice.tip, choice.lock, fixed)
    first = chains[0]
    if is_planar(urdf, posture, first.joints, first.tip) or in_line(first.joints, posture):
        return _planar(urdf, posture, choice, fixed, excluded)
    chosen, note = choose_chain(chains, strict=choice.columns is not None)
    notes = [note] if note else []
    unlogged = [joint.name for joint in urdf.path(chosen.tip) if joint.name in idle]
    if unlogged:
        notes.append(f"locked because the log has no columns for them: {listed(unlogged)}")
    planar = _only_planar(find_candidates(urdf, posture, choice.tip, excluded))
    if planar:
        notes.append(f"the arm moves in space; `planar=True` takes its planar part: {planar}")
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
    urdf: Urdf,
    posture: Posture,
    choice: Choice,
    fixed: Collection[str],
    excluded: Collection[str],
) -> tuple[Found, list[str]]:
    candidates = find_candidates(urdf, posture, choice.tip, excluded)
    if not candidates:
        raise nothing_found(urdf, posture, choice.tip, choice.lock, fixed)
    chosen, note = choose(candidates)
    return (list(chosen.joints), chosen.tip, True), [note] if note else []


def _only_planar(candidates: Sequence[Candidate]) -> Candidate | None:
    """Return the planar arm that would be chosen, or None where there is none or several."""
    if not candidates:
        return None
    try:
        return choose(candidates)[0]
    except RobotError:
        return None
