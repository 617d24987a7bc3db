"""URDF: a robot description as a checked tree of links and joints.

Harmless gaps are filled and noted; what is wrong is refused in one line.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array, Range
from ..common.wording import listing, quoted, suggestion
from ..errors import RobotError
from .rigid import rigid
from .robot_text import LIMITS, Attributes, Vector
from .rotations import exponential

MOVABLE = ("revolute", "continuous", "prismatic")
_ZERO = (0.0, 0.0, 0.0)


class Mimic(NamedTuple):
    """A joint's coupling to another: value = multiplier * leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint of a URDF; `limits` are its lower and upper value [rad or m], if stated."""

    name: str
    kind: str
    parent: str
    child: str
    # (4, 4), in the parent link's frame
    origin: Array = field(default_factory=lambda: np.eye(4))
    axis: Vector = (1.0, 0.0, 0.0)
    limits: Range | None = None
    mimic: Mimic | None = None

    @property
    def movable(self) -> bool:
        """Whether the joint moves at all."""
        return self.kind in MOVABLE

    @property
    def revolute(self) -> bool:
        """Whether the joint turns (rad) rather than slides (m)."""
        return self.kind != "prismatic"

    @property
    def unit(self) -> str:
        """Unit of the joint's value."""
        return "rad" if self.revolute else "m"

    @property
    def stuck(self) -> bool:
        """Whether its limits leave it no room at all."""
        return self.limits is not None and self.limits[0] == self.limits[1]

    @property
    def fault(self) -> str | None:
        """Why its limits cannot bound what is babbled, None if they can."""
        if self.kind == "continuous":
            return None
        if self.limits is None:
            return "it states no limits"
        lower, upper = self.limits
        if lower < upper and (self.revolute or upper - lower <= LIMITS.travel):
            return None
        return f"its limits {lower:g} to {upper:g} {self.unit} are unusable"

    @property
    def travel(self) -> Range:
        """Range that it can mechanically reach, infinite without limits."""
        if self.limits is None or self.fault:
            return -math.inf, math.inf
        return self.limits

    @property
    def neutral(self) -> float:
        """Zero, clipped into its limits where it has sensible ones."""
        lower, upper = self.travel
        if self.stuck and self.limits:
            lower, upper = self.limits
        return min(max(0.0, lower), upper)


@dataclass(frozen=True)
class Urdf:
    """A checked tree of links and joints.

    `notes` are things that were mended, for the user.
    """

    name: str
    root: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    notes: tuple[str, ...]
    # [kg] of links, and their centres [m]
    masses: Mapping[str, tuple[float, Vector]]

    def joint(self, name: str) -> Joint | None:
        """Return the joint of that name, or None."""
        return next(
            (joint for joint in self.joints if joint.name == name), None
        )

    def path(self, link: str) -> tuple[Joint, ...]:
        """Joints from the root to a link, in that order."""
        path: list[Joint] = []
        while link in self._above:
            path.append(self._above[link])
            link = path[-1].parent
        return tuple(reversed(path))

    def mimic_of(self, joint: Joint, stops: Collection[str]) -> Mimic:
        """How a joint follows another, over mimic joints in between that are none of `stops`.

        A joint that follows none, or is one of `stops`, follows itself.
        """
        scale = 1.0
        offset = 0.0
        passed = [*stops]
        while joint.mimic and joint.name not in passed:
            leader = self.joint(joint.mimic.leader)
            if leader is None:
                break
            passed.append(joint.name)
            offset += scale * joint.mimic.offset
            scale *= joint.mimic.multiplier
            joint = leader
        return Mimic(joint.name, scale, offset)

    def values(self, chosen: Mapping[str, float]) -> dict[str, float]:
        """Values [rad or m] of all movable joints: as chosen, as what they follow, or neutral."""
        movable = [joint for joint in self.joints if joint.movable]
        free = {
            joint.name: float(chosen.get(joint.name, joint.neutral))
            for joint in movable
        }
        values: dict[str, float] = {}
        for joint in movable:
            leader, scale, offset = self.mimic_of(joint, chosen)
            values[joint.name] = scale * free.get(leader, 0.0) + offset
        return values

    def below(self, link: str) -> tuple[Joint, ...]:
        """Joints that a link carries directly, in file order."""
        return self._below.get(link, ())

    def carries(self, link: str) -> bool:
        """Whether some movable joint lies beyond a link."""
        return any(j.movable or self.carries(j.child) for j in self.below(link))

    @cached_property
    def _above(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def _below(self) -> dict[str, tuple[Joint, ...]]:
        parents = {joint.parent for joint in self.joints}
        return {
            link: tuple(j for j in self.joints if j.parent == link)
            for link in parents
        }


def read_urdf_tree(robot: ET.Element, name: str) -> Urdf:
    """Check the root element of a URDF and return its links and joints.

    name : name to use where the URDF gives its robot none
    Raises RobotError: what is wrong, what was expected and what to do.
    """
    notes: list[str] = []
    title = robot.get("name", "").strip() or name
    links = _names(robot, "link")
    joint_names = _names(robot, "joint")
    if not links:
        raise RobotError(
            "the URDF has no links: expected a robot with links and joints"
        )
    if len(joint_names) > LIMITS.joints:
        raise RobotError(
            f"the URDF has {len(joint_names)} joints, expected at most {LIMITS.joints}"
        )
    joints = tuple(
        _read_joint(node, links, notes) for node in robot.findall("joint")
    )
    for joint in joints:
        if joint.mimic and joint.mimic.leader not in joint_names:
            notes.append(
                f"joint {quoted(joint.name)} mimics {quoted(joint.mimic.leader)}, "
                "which does not exist: it is held where it is"
            )
    root = _find_root(links, joints)
    masses = dict(_masses(robot))
    return Urdf(title, root, tuple(links), joints, tuple(notes), masses)


def _names(robot: ET.Element, tag: str) -> dict[str, None]:
    """Names of all elements of one kind, in file order: stated, and each only once."""
    names: dict[str, None] = {}
    for number, node in enumerate(robot.findall(tag), 1):
        name = node.get("name", "")
        if not name.strip():
            raise RobotError(
                f"{tag} number {number} of the URDF has no name: give it one"
            )
        if name in names:
            raise RobotError(
                f"two {tag}s are named {quoted(name)}: rename one of them"
            )
        names[name] = None
    return names


def _read_joint(
    node: ET.Element, links: Collection[str], notes: list[str]
) -> Joint:
    name = node.get("name", "")
    kind = node.get("type", "")
    where = f"joint {quoted(name)}"
    if kind not in (*MOVABLE, "fixed"):
        raise RobotError(
            f"{where} has type {quoted(kind)}: only fixed, revolute, continuous and prismatic "
            "joints are supported; make it fixed"
        )
    parent = _end(node, "parent", where, links)
    child = _end(node, "child", where, links)
    origin = _origin(node, where)
    axis: Vector = (1.0, 0.0, 0.0)
    if kind != "fixed":
        direction = _part(node, "axis", where)
        if "xyz" not in direction:
            notes.append(f"{where} has no <axis>: URDF's default, x, is used")
        axis = direction.numbers("xyz", axis)
        if not 1 / LIMITS.axis <= math.hypot(*axis) <= LIMITS.axis:
            raise RobotError(
                f"{where} has the axis {' '.join(f'{part:g}' for part in axis)}: give a direction "
                "such as 0 0 1"
            )
    limits: Range | None = None
    ends = _part(node, "limit", where)
    if kind in ("revolute", "prismatic") and ends.keys() & {"lower", "upper"}:
        limits = (
            ends.number("lower", infinite=True),
            ends.number("upper", infinite=True),
        )
    mimic: Mimic | None = None
    follows = _part(node, "mimic", where)
    if follows:
        scale = follows.number("multiplier", 1.0)
        mimic = Mimic(follows.get("joint", ""), scale, follows.number("offset"))
    return Joint(name, kind, parent, child, origin, axis, limits, mimic)


def _origin(node: ET.Element, where: str) -> Array:
    """Return where a joint is in its parent link's frame (4, 4)."""
    place = _part(node, "origin", where)
    xyz = place.numbers("xyz", _ZERO)
    rpy = place.numbers("rpy", _ZERO)
    far = max(map(abs, xyz))
    if far > LIMITS.offset:
        raise RobotError(
            f"{where}: origin xyz reaches {far:g} m, expected at most {LIMITS.offset:g} m: URDF "
            "placements are in metres"
        )
    # about the fixed x, y and z axes, in this order
    x, y, z = exponential(np.diag(rpy))
    return rigid(z @ y @ x, xyz)


def _part(node: ET.Element, path: str, where: str) -> Attributes:
    """Return the attributes of an element's part; none where there is no such part."""
    part = node.find(path)
    return Attributes(f"{where}: {path}", {} if part is None else part.attrib)


def _end(node: ET.Element, tag: str, where: str, links: Collection[str]) -> str:
    """Return the link at one end of a joint."""
    ends = node.findall(tag)
    if len(ends) != 1:
        raise RobotError(
            f"{where} has {len(ends)} <{tag}> elements, expected one"
        )
    link = ends[0].get("link", "")
    if link not in links:
        raise RobotError(
            f"{where} has the {tag} link {quoted(link)}, which does not exist: "
            f"{suggestion(link, sorted(links))}"
        )
    return link


def _masses(robot: ET.Element) -> Iterator[tuple[str, tuple[float, Vector]]]:
    """Masses and centres of links; what is no positive finite number is left out."""
    for link in robot.findall("link"):
        with suppress(RobotError):
            mass = _part(link, "inertial/mass", "link").number("value")
            if 0 < mass < LIMITS.mass:
                place = _part(link, "inertial/origin", "link")
                centre = place.numbers("xyz", _ZERO)
                yield link.get("name", ""), (mass, centre)


def _find_root(links: Collection[str], joints: tuple[Joint, ...]) -> str:
    """Return the one link without a parent, or raise the reason why the links are no tree."""
    above = {joint.child: joint for joint in joints}
    roots = [link for link in links if link not in above]
    doubled = [j.name for j in joints if above[j.child] is not j]
    several = roots if len(roots) > 1 else []
    reached = set(roots)
    for _ in joints:
        reached |= {j.child for j in joints if j.parent in reached}
    looped = [joint.name for joint in joints if joint.child not in reached]
    faults = {
        f"{len(roots)} root links, join them with fixed joints": several,
        "joints to a link that has another parent, remove one": doubled,
        "joints in a loop, remove one": looped,
    }
    for fault, names in faults.items():
        if names:
            raise RobotError(
                f"the URDF is no tree of links: {fault}: {listing(names, 4)}"
            )
    return roots[0]
