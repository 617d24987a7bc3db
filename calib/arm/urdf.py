"""URDF: read, check and explain a robot description before any library sees it.

Only the standard library's XML parser is used.  Pinocchio gets the joints that pass and never the
text: harmless gaps do no harm, and real faults are told in one line.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ..common.wording import listed, quoted, suggestion
from ..errors import RobotError

MAX_BYTES = 50_000_000
MAX_JOINTS = 1_000  # Pinocchio recurses along the chain and overflows its stack beyond
_MAX_OFFSET = 1e6  # [m]; further out a double has no micrometres left
_LONGEST_AXIS = 1e6  # Pinocchio squares it
_HEAVIEST = 1e5  # [kg]; heavier is a mistake in the file, not an arm's link

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_INFINITE = re.compile(r"([+-]?)inf(inity)?", re.IGNORECASE)

Vector = tuple[float, float, float]

MOVABLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Mimic:
    """A joint's coupling to another: value = multiplier * leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """One joint of a URDF; `limits` are its lower and upper value [rad or m], if stated."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: Vector
    rpy: Vector
    axis: Vector
    limits: tuple[float, float] | None
    mimic: Mimic | None

    @property
    def movable(self) -> bool:
        """Whether the joint moves at all."""
        return self.kind in MOVABLE

    @property
    def revolute(self) -> bool:
        """Whether the joint turns (rad) rather than slides (m)."""
        return self.kind != "prismatic"


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
    masses: Mapping[str, tuple[float, Vector]]  # [kg] of links, and their centres [m]

    def joint(self, name: str) -> Joint | None:
        """Return the joint of that name, or None."""
        return next((joint for joint in self.joints if joint.name == name), None)

    def path(self, link: str) -> tuple[Joint, ...]:
        """Joints from the root to a link, in that order."""
        path: list[Joint] = []
        while link in self._above:
            path.append(self._above[link])
            link = path[-1].parent
        return tuple(reversed(path))

    def below(self, link: str) -> tuple[Joint, ...]:
        """Joints that a link carries directly, in file order."""
        return tuple(joint for joint in self.joints if joint.parent == link)

    def carries(self, link: str) -> bool:
        """Whether some movable joint lies beyond a link."""
        return any(j.movable or self.carries(j.child) for j in self.below(link))

    @cached_property
    def _above(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints}


def read_urdf(path: Path) -> str:
    """Read a URDF file as text.

    Raises RobotError if it is missing, a folder, empty, not UTF-8, or larger than `MAX_BYTES`.
    """
    try:
        if not path.is_file():  # some devices never end
            raise RobotError(f"{path}: is no file, expected a URDF or a bundled robot")
        with path.open("rb") as file:
            text = file.read(MAX_BYTES + 1).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RobotError(
            f"{path}: byte {error.start} is not UTF-8: save the URDF as UTF-8 text"
        ) from None
    except (OSError, ValueError) as error:
        raise RobotError(f"{path}: cannot be read: {error}") from None
    if not text.strip() or len(text) > MAX_BYTES:
        size = f"{MAX_BYTES // 1_000_000} MB"
        raise RobotError(f"{path}: is empty or above {size}, expected a URDF without its meshes")
    return text


def parse_urdf(text: str, name: str = "robot") -> Urdf:
    """Check the text of a URDF and return its links and joints.

    name : name to use where the URDF gives its robot none
    Raises RobotError: what is wrong, what was expected and what to do.
    """
    robot = _parse_xml(text)
    notes: list[str] = []
    own_name = (robot.get("name") or "").strip()
    if not own_name:
        notes.append(f"the URDF gives the robot no name: {name} is used")
    links = _names(robot, "link")
    joint_names = _names(robot, "joint")
    if max(len(joint_names), len(links) - 1) > MAX_JOINTS:
        raise RobotError(
            f"the URDF has {len(links)} links and {len(joint_names)} joints, expected at most "
            f"{MAX_JOINTS} joints"
        )
    joints = tuple(_read_joint(node, set(links), notes) for node in robot.findall("joint"))
    for joint in joints:
        if joint.mimic and joint.mimic.leader not in joint_names:
            notes.append(
                f"joint {quoted(joint.name)} mimics {quoted(joint.mimic.leader)}, "
                "which does not exist: it is held where it is"
            )
    root = _find_root(links, joints)
    masses = dict(_masses(robot))
    return Urdf(own_name or name, root, tuple(links), joints, tuple(notes), masses)


def _parse_xml(text: str) -> ET.Element:
    upper = text.upper()
    for mark in ("<!DOCTYPE", "<!ENTITY"):
        if mark in upper:
            raise RobotError(
                f"the URDF holds {mark}: document types and entities are refused; remove it "
                "and write its values out"
            )
    try:
        robot = ET.fromstring(text)  # noqa: S314 - entities were refused above
    except (ET.ParseError, ValueError) as error:
        if "unbound prefix" in str(error) and "<xacro:" in text:
            raise _xacro_error("<xacro:...>") from None
        cut = any(word in str(error) for word in ("no element", "unclosed", "no closing"))
        remedy = "the file seems truncated, fetch it again" if cut else "correct it there"
        raise RobotError(f"the URDF is not well-formed XML ({error}): {remedy}") from None
    if robot.tag != "robot":
        hint = " (SDF: convert it to URDF first)" if robot.tag == "sdf" else ""
        raise RobotError(f"the file's root element is <{robot.tag[:60]}>, expected <robot>{hint}")
    for node in robot.iter():
        if isinstance(node.tag, str) and "xacro}" in node.tag:
            raise _xacro_error(f"<xacro:{node.tag.split('}')[1]}>")
        for value in node.attrib.values():
            if "${" in value:
                raise _xacro_error(value)
    return robot


def _xacro_error(found: str) -> RobotError:
    return RobotError(
        f"the URDF still holds xacro ({quoted(found)}): expand it first, "
        "for example: xacro robot.xacro > robot.urdf"
    )


def _names(robot: ET.Element, tag: str) -> list[str]:
    """Names of all elements of one kind: stated, and each only once."""
    names: dict[str, None] = {}
    for number, node in enumerate(robot.findall(tag), 1):
        name = node.get("name", "")
        if not name.strip():
            raise RobotError(f"{tag} number {number} of the URDF has no name: give it one")
        if name in names:
            raise RobotError(f"two {tag}s are named {quoted(name)}: rename one of them")
        names[name] = None
    if not names and tag == "link":
        raise RobotError("the URDF has no links: expected a robot with links and joints")
    return list(names)


def _read_joint(node: ET.Element, links: set[str], notes: list[str]) -> Joint:
    name = node.get("name", "")
    where = f"joint {quoted(name)}"
    kind = node.get("type", "")
    if kind in ("floating", "planar"):
        raise RobotError(
            f"{where} is {kind}: only fixed, revolute, continuous and prismatic joints are "
            "supported; make it fixed"
        )
    if kind not in (*MOVABLE, "fixed"):
        raise RobotError(
            f"{where} has type {quoted(kind)}, expected one of fixed, {', '.join(MOVABLE)}"
        )
    parent, child = (_end(node, tag, where, links) for tag in ("parent", "child"))
    origin = node.find("origin")
    xyz = _vector(origin, "xyz", where, (0.0, 0.0, 0.0))
    rpy = _vector(origin, "rpy", where, (0.0, 0.0, 0.0))
    if max(map(abs, xyz)) > _MAX_OFFSET:
        raise RobotError(
            f"{where}: origin xyz reaches {max(map(abs, xyz)):g} m, expected at most "
            f"{_MAX_OFFSET:g} m: URDF placements are in metres"
        )
    axis = (1.0, 0.0, 0.0)
    if kind != "fixed":
        stated = node.find("axis")
        if stated is None or "xyz" not in stated.attrib:
            notes.append(f"{where} has no <axis>: URDF's default, x, is used")
        axis = _vector(stated, "xyz", where, axis)
        if not 1 / _LONGEST_AXIS <= math.hypot(*axis) <= _LONGEST_AXIS:
            shown = " ".join(f"{part:g}" for part in axis)
            raise RobotError(f"{where} has the axis {shown}: give a direction such as 0 0 1")
    limits = _limits(node, where) if kind in ("revolute", "prismatic") else None
    return Joint(name, kind, parent, child, xyz, rpy, axis, limits, _mimic(node, where))


def _end(node: ET.Element, tag: str, where: str, links: set[str]) -> str:
    ends = node.findall(tag)
    if len(ends) != 1:
        raise RobotError(f"{where} has {len(ends)} <{tag}> elements, expected one")
    link = ends[0].get("link", "")
    if link not in links:
        raise RobotError(
            f"{where} has the {tag} link {quoted(link)}, which does not exist: "
            f"{suggestion(link, sorted(links))}"
        )
    return link


def _limits(node: ET.Element, where: str) -> tuple[float, float] | None:
    limit = node.find("limit")
    if limit is None or not {"lower", "upper"} & set(limit.attrib):
        return None
    lower, upper = (
        _number(limit.get(key, "0"), f"{where}: limit {key}", infinite=True)
        for key in ("lower", "upper")
    )
    return lower, upper


def _mimic(node: ET.Element, where: str) -> Mimic | None:
    mimic = node.find("mimic")
    if mimic is None:
        return None
    multiplier, offset = (
        _number(mimic.get(key, default), f"{where}: mimic {key}")
        for key, default in (("multiplier", "1"), ("offset", "0"))
    )
    return Mimic(mimic.get("joint", ""), multiplier, offset)


def _vector(node: ET.Element | None, key: str, where: str, default: Vector) -> Vector:
    text = None if node is None else node.get(key)
    if node is None or text is None:
        return default
    parts = text.split()
    if len(parts) != 3:
        raise RobotError(f"{where}: <{node.tag} {key}={quoted(text)}>, expected three numbers")
    x, y, z = (_number(part, f"{where}: {node.tag} {key}") for part in parts)
    return x, y, z


def _number(text: str, where: str, *, infinite: bool = False) -> float:
    """Read a number as URDF libraries do, not as Python does (1_000, nan)."""
    text = text.strip()
    if infinite and _INFINITE.fullmatch(text):
        return -math.inf if text.startswith("-") else math.inf
    value = float(text) if len(text) <= 64 and _NUMBER.fullmatch(text) else math.nan
    if not (math.isfinite(value) or (infinite and math.isinf(value))):
        raise RobotError(f"{where} is {quoted(text)}, expected a finite number")
    return value


def _masses(robot: ET.Element) -> Iterator[tuple[str, tuple[float, Vector]]]:
    """Masses and centres of links; what is no positive finite number is left out."""
    for link in robot.findall("link"):
        origin, mass = link.find("inertial/origin"), link.find("inertial/mass")
        if mass is not None:
            with suppress(RobotError):
                value = _number(mass.get("value", ""), "mass")
                if 0 < value < _HEAVIEST:
                    yield link.get("name", ""), (value, _vector(origin, "xyz", "mass", (0, 0, 0)))


def _find_root(links: list[str], joints: tuple[Joint, ...]) -> str:
    """Return the one link without a parent, or say why the links are no tree."""
    above: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in above:
            raise RobotError(
                f"link {quoted(joint.child)} has two parents, joints "
                f"{quoted(above[joint.child].name)} and {quoted(joint.name)}: remove one"
            )
        above[joint.child] = joint
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise RobotError(
            f"the URDF has {len(roots)} root links, {listed(map(quoted, roots), 4)}: "
            "expected one; join them with fixed joints"
        )
    reached, waiting = set[str](), list(roots)
    while waiting:
        reached.add(link := waiting.pop())
        waiting += [joint.child for joint in joints if joint.parent == link]
    loop = next((link for link in links if link not in reached), None)
    if loop is not None:
        raise RobotError(
            f"link {quoted(loop)} is part of a loop of joints: a URDF must be a tree; "
            f"remove joint {quoted(above[loop].name)}"
        )
    return roots[0]
