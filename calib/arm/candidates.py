"""Candidates: the planar arms within a robot, for users who did not name theirs.

A candidate is a set of joints that move a tip within one plane. Among them the one that
reaches over the largest area is an arm; fingers, wrists and wheels reach over little.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..common.arrays import Array
from ..common.wording import listed
from ..errors import RobotError
from .plane import MIN_LEVER, PARALLEL, check_tip, common_normal, fits
from .posture import Posture
from .ranges import full_range, limits_fault, ranges_wanted
from .tree import Joint, Urdf

#: Joints that are chosen without being asked: at most so many, and none whose link is
#: shorter than this share of the arm's reach.
_MOST_JOINTS = 3
_MIN_SHARE = 0.05
#: A candidate with less than this share of the best one's area is no rival to it.
RIVAL = 0.5

#: Usual names (their ends) of the frame that a robot's maker means by its tip.
_TIP_NAMES = ("tool0", "tcp", "tool", "tip", "ee_link", "ee", "end_effector", "gripper_frame_link")


@dataclass(frozen=True)
class Candidate:
    """An arm within a robot: joints from base to tip, and how large it is.

    The size is the area that a planar arm reaches over [m2], of others the reach [m].
    """

    joints: tuple[Joint, ...]
    tip: str
    size: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    def __str__(self) -> str:
        return f"`joints={list(self.names)}` `tip={self.tip!r}`"


def largest(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the largest candidate of each set of joints, the largest of all first."""
    best: dict[tuple[str, ...], Candidate] = {}
    for found in candidates:
        if found.names not in best or best[found.names].size < found.size:
            best[found.names] = found
    return sorted(best.values(), key=lambda found: (-round(found.size, 6), str(found)))


def alternatives(candidates: Sequence[Candidate], most: int) -> str:
    """Return the options that name each candidate, the first `most` of them."""
    return "; ".join(map(str, candidates[:most])) + ("; ..." if len(candidates) > most else "")


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


def _named_tip(joints: Sequence[Joint]) -> tuple[Joint, ...]:
    for name in _TIP_NAMES:
        named = tuple(joint for joint in joints if joint.child.lower().endswith(name))
        if named:
            return named if len(named) == 1 else ()
    return ()


def find_candidates(
    urdf: Urdf, posture: Posture, tip: str | None, excluded: Collection[str]
) -> list[Candidate]:
    """Return the planar arms of a robot, the one with most reach first.

    `posture` has all joints at their locked values; `excluded` (locked, or fixed by their
    limits) are not to be used.
    """
    joints = [joint for joint in urdf.joints if joint.movable and not joint.mimic]
    usable = {joint.name for joint in joints if joint.name not in excluded}
    tips = [tip] if tip else sorted({find_tip(urdf, joint.child) for joint in joints})
    found: list[Candidate] = []
    for link in tips:
        path = [joint for joint in urdf.path(link) if joint.name in usable]
        for members, normal in _planar_sets(path, posture):
            candidate = _trim(members, normal, link, posture)
            if candidate is None:
                continue
            if tip is None and find_tip(urdf, candidate.joints[-1].child) != link:
                continue
            found.append(candidate)
    return largest(found)


def rivals(candidates: Sequence[Candidate], share: float) -> list[Candidate]:
    """Return the candidates, largest first, of at least a share of the largest one's size."""
    return [found for found in candidates if found.size >= share * candidates[0].size]


def choose(
    candidates: Sequence[Candidate], share: float, what: str, *, strict: bool = True
) -> tuple[Candidate, str | None]:
    """Return the largest candidate, and what to say where others have that share of its size.

    `strict` refuses those with the options that name each, by a RobotError; else the first serves.
    """
    best, equals = candidates[0], rivals(candidates, share)
    if len(equals) == 1:
        return best, None
    if strict:
        shown = alternatives(equals, 6)
        raise RobotError(f"the robot has {len(equals)} {what}, choose one: {shown}")
    others = alternatives(equals[1:], 3)
    return best, f"chosen, as the first of {len(equals)} {what}: {best} (others: {others})"


def nothing_found(
    urdf: Urdf, posture: Posture, tip: str | None, locked: Collection[str], fixed: Collection[str]
) -> RobotError:
    """Explain that a robot (or a tip) has no planar arm.

    `locked` are joints that the user holds, `fixed` those that their limits leave no room, and
    that the user gave no range.
    """
    to_tip = f" that moves {tip!r}" if tip else ""
    joints = urdf.path(tip) if tip else urdf.joints
    moving = [joint for joint in joints if joint.movable and not joint.mimic]
    if freed := find_candidates(urdf, posture, tip, locked):
        stuck = [joint for joint in freed[0].joints if joint.name in fixed]
        faults = "; ".join(f"{joint.name}: {limits_fault(joint)}" for joint in stuck)
        return RobotError(
            f"no planar arm{to_tip} without joints that have no room to move; {faults}",
            hint=f"give {ranges_wanted(stuck)}",
            parameter="ranges",
        )
    free = [joint for joint in moving if joint.name not in locked]
    chains = [[joint for joint in urdf.path(end.child) if joint in free] for end in free]
    turning = [joint for joint in max(chains, key=len, default=[]) if joint.revolute]
    try:
        if len(turning) == 2:  # the one pair there is: say what is wrong with it
            common_normal(turning, posture)
        for members, _ in (found for chain in chains for found in _planar_sets(chain, posture)):
            if len(members) > 1:
                last = members[-1]
                check_tip(last, tip or find_tip(urdf, last.child), urdf, posture)
    except RobotError as error:
        return error
    held = f", of which {listed(locked)} is locked" if locked else ""
    return RobotError(
        f"no planar arm{to_tip}: it needs two movable joints in one chain and, as tip, a frame "
        f"off the last one's axis; movable joints: {listed(joint.name for joint in moving)}{held}"
    )


def _planar_sets(path: list[Joint], posture: Posture) -> list[tuple[list[Joint], Array]]:
    """Find sets of joints along a path that share a plane, each with its normal."""
    sets: list[tuple[list[Joint], Array]] = []
    left = [joint for joint in path if joint.revolute]
    while left:
        normal = posture.axes[left[0].name]
        members = [joint for joint in path if fits(joint, posture.axes[joint.name], normal)]
        sets.append((members, normal))
        left = [joint for joint in left if joint not in members]
    slides = [joint for joint in path if not joint.revolute]
    for pair in combinations(slides, 2):
        normal = np.cross(posture.axes[pair[0].name], posture.axes[pair[1].name])
        length = np.linalg.norm(normal)
        if length > PARALLEL and not any(set(pair) <= set(members) for members, _ in sets):
            sets.append((list(pair), normal / length))
    return sets


def _trim(members: list[Joint], normal: Array, tip: str, posture: Posture) -> Candidate | None:
    """Leave out joints that hardly move the tip, and more than `_MOST_JOINTS`."""
    members = list(members)
    while len(members) >= 2:
        stops = [*(posture.points[joint.name] for joint in members), posture.links[tip]]
        vectors = np.diff(np.array(stops), axis=0)
        levers = np.linalg.norm(vectors - np.outer(vectors @ normal, normal), axis=1)
        for k, joint in enumerate(members):
            if not joint.revolute:
                lower, upper = (0.0, 1.0) if limits_fault(joint) else full_range(joint)
                levers[k] = max(levers[k], upper - lower)
        weakest = int(np.argmin(levers))
        small = levers[weakest] < max(_MIN_SHARE * levers.sum(), MIN_LEVER)
        if not small and len(members) <= _MOST_JOINTS:
            # two links a, b sweep the ring pi ((a + b)^2 - (a - b)^2) = 4 pi a b
            pairs = combinations(levers, 2)
            return Candidate(tuple(members), tip, float(4 * np.pi * sum(a * b for a, b in pairs)))
        del members[weakest]
    return None
