"""URDF: read, check and explain a robot description before any library sees it.

Only the standard library's XML parser is used: harmless gaps do no harm, and real faults are chosen
in one line.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from ..common.wording import listed, quoted, suggestion
from ..errors import RobotError


@dataclass(frozen=True)
class Limits:
    """What a description may say at most; more is a mistake in the file, or an attack."""

    size: int = 50_000_000  # [bytes]
    joints: int = 1_000  # links are followed by recursion
    # [m]; a slide that claims more states no usable limit
    travel: float = 1_000.0
    offset: float = 1e6  # [m]; further out a double has no micrometres left
    axis: float = 1e6  # length whose square overflows long before a double does
    mass: float = 1e5  # [kg]; heavier is no link of an arm


LIMITS = Limits()

_NUMBER = re.compile(
    r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|inf(inity)?)", re.IGNORECASE
)

Vector = tuple[float, ...]
Rows = tuple[Vector, Vector, Vector]
Range = tuple[float, float]

MJCF = "mujoco"
"""Root element of the other kind of description that is read, see `calib.arm.mjcf`."""

UPRIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Rows of an orientation that is the parent's."""

MOVABLE = ("revolute", "continuous", "prismatic")


class Mimic(NamedTuple):
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
    xyz: Vector = (0.0, 0.0, 0.0)  # [m], its origin in the parent link's frame
    rotation: Rows = UPRIGHT  # rows of that origin's orientation
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
        """Range that it can mechanically reach, infinite where its limits do not say."""
        return (
            (-math.inf, math.inf)
            if self.limits is None or self.fault
            else self.limits
        )

    @property
    def neutral(self) -> float:
        """Zero, clipped into its limits where it has sensible ones."""
        lower, upper = (
            self.limits if self.stuck and self.limits else self.travel
        )
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
    masses: Mapping[
        str, tuple[float, Vector]
    ]  # [kg] of links, and their centres [m]

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

    def followed(self, joint: Joint, stops: Collection[str] = ()) -> Mimic:
        """What a joint follows in the end, over other mimic joints that are none of `stops`.

        That is the joint itself where it follows none.
        """
        scale = 1.0
        offset = 0.0
        passed = [joint.name, *stops]
        stop = joint.name in stops
        while (
            not stop
            and joint.mimic
            and (leader := self.joint(joint.mimic.leader))
        ):
            offset += scale * joint.mimic.offset
            scale *= joint.mimic.multiplier
            stop = leader.name in passed
            joint = leader
            passed.append(joint.name)
        return Mimic(joint.name, scale, offset)

    def values(self, chosen: Mapping[str, float]) -> dict[str, float]:
        """Values [rad or m] of all movable joints: as chosen, as what they follow, or neutral."""
        movable = [joint for joint in self.joints if joint.movable]
        free = {
            joint.name: float(chosen.get(joint.name, joint.neutral))
            for joint in movable
        }
        follows = {
            joint.name: self.followed(joint, chosen) for joint in movable
        }
        return {
            n: m.multiplier * free.get(m.leader, 0.0) + m.offset
            for n, m in follows.items()
        }

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


def read_urdf(path: Path) -> str:
    """Read a URDF file as text.

    Raises RobotError if it is missing, a folder, empty, not UTF-8, or larger than `LIMITS.size`.
    """
    try:
        if not path.is_file():  # some devices never end
            raise RobotError(
                f"{path}: is no file, expected a URDF or a bundled robot"
            )
        with path.open("rb") as file:
            text = file.read(LIMITS.size + 1).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RobotError(
            f"{path}: byte {error.start} is not UTF-8: save the URDF as UTF-8 text"
        ) from None
    except (OSError, ValueError) as error:
        raise RobotError(f"{path}: cannot be read: {error}") from None
    if not text.strip() or len(text) > LIMITS.size:
        size = f"{LIMITS.size // 1_000_000} MB"
        raise RobotError(
            f"{path}: is empty or above {size}, expected a URDF without its meshes"
        )
    return text


def read_urdf_tree(robot: ET.Element, name: str = "robot") -> Urdf:
    """Check the root element of a URDF and return its links and joints.

    name : name to use where the URDF gives its robot none
    Raises RobotError: what is wrong, what was expected and what to do.
    """
    notes: list[str] = []
    own_name = robot.get("name", "").strip()
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
    return Urdf(
        own_name or name, root, tuple(links), joints, tuple(notes), masses
    )


def parse_xml(text: str) -> ET.Element:
    """The root element of a robot's description.

    Raises RobotError if it is none, or holds what has to be expanded first.
    """
    for mark in ("<!DOCTYPE", "<!ENTITY"):
        if mark in text.upper():
            raise RobotError(
                f"the URDF holds {mark}: document types and entities are refused; remove it "
                "and write its values out"
            )
    expand = "expand xacro first, for example: xacro robot.xacro > robot.urdf"
    try:
        robot = ET.fromstring(text)  # noqa: S314 - entities were refused above
    except (ET.ParseError, ValueError) as error:
        remedy = (
            expand
            if "<xacro:" in text
            else "correct it there, or fetch a truncated file anew"
        )
        raise RobotError(
            f"the URDF is not well-formed XML ({error}): {remedy}"
        ) from None
    if robot.tag not in ("robot", MJCF):
        raise RobotError(
            f"the file's root element is <{robot.tag[:60]}>, expected <robot> or <mujoco>: convert "
            "SDF and other formats to URDF first"
        )
    for node in robot.iter():
        for word in (node.tag, *node.attrib.values()):
            if "xacro}" in word or "${" in word:
                raise RobotError(
                    f"the URDF still holds {quoted(word)}: {expand}"
                )
    return robot


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
    parent, child = (
        _end(node, tag, where, links) for tag in ("parent", "child")
    )
    xyz = _numbers(node, "origin", "xyz", (0.0, 0.0, 0.0), where)
    rpy = _numbers(node, "origin", "rpy", (0.0, 0.0, 0.0), where)
    if (far := max(map(abs, xyz))) > LIMITS.offset:
        raise RobotError(
            f"{where}: origin xyz reaches {far:g} m, expected at most {LIMITS.offset:g} m: URDF "
            "placements are in metres"
        )
    axis: Vector = (1.0, 0.0, 0.0)
    if kind != "fixed":
        x, y, z = axis = _numbers(node, "axis", "xyz", axis, where)
        if node.find("axis[@xyz]") is None:
            notes.append(f"{where} has no <axis>: URDF's default, x, is used")
        if not 1 / LIMITS.axis <= math.hypot(*axis) <= LIMITS.axis:
            raise RobotError(
                f"{where} has the axis {x:g} {y:g} {z:g}: give a direction such as 0 0 1"
            )
    limits: Range | None = None
    stated = [node.find(f"limit[@{key}]") for key in ("lower", "upper")]
    if kind in ("revolute", "prismatic") and stated != [None, None]:
        (lower,) = _numbers(
            node, "limit", "lower", (0.0,), where, infinite=True
        )
        (upper,) = _numbers(
            node, "limit", "upper", (0.0,), where, infinite=True
        )
        limits = lower, upper
    mimic: Mimic | None = None
    if (follows := node.find("mimic")) is not None:
        (multiplier,) = _numbers(node, "mimic", "multiplier", (1.0,), where)
        (offset,) = _numbers(node, "mimic", "offset", (0.0,), where)
        mimic = Mimic(follows.get("joint", ""), multiplier, offset)
    return Joint(
        name, kind, parent, child, xyz, _rotation(*rpy), axis, limits, mimic
    )


def _rotation(roll: float, pitch: float, yaw: float) -> Rows:
    """Rows of the rotation by angles [rad] about the fixed x, y and z axes, in this order."""
    # without NumPy, whose import takes longer than to list robots
    cr = math.cos(roll)
    sr = math.sin(roll)
    cp = math.cos(pitch)
    sp = math.sin(pitch)
    cy = math.cos(yaw)
    sy = math.sin(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def _end(node: ET.Element, tag: str, where: str, links: Collection[str]) -> str:
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


def _numbers(
    node: ET.Element,
    path: str,
    key: str,
    default: Vector,
    where: str,
    *,
    infinite: bool = False,
) -> Vector:
    """Read an attribute's numbers as URDF libraries do, not as Python does (1_000, nan)."""
    part = node.find(path)
    text = None if part is None else part.get(key)
    if text is None:
        return default
    values = as_numbers(text)
    usable = [
        not math.isnan(v) if infinite else math.isfinite(v) for v in values
    ]
    if len(values) != len(default) or not all(usable):
        count = {1: "a finite number", 3: "three finite numbers"}[len(default)]
        raise RobotError(
            f"{where}: {path} {key} is {quoted(text)}, expected {count}"
        )
    return values


def as_numbers(text: str) -> Vector:
    """Numbers with spaces between them; NaN where a word is none."""
    return tuple(
        float(word) if len(word) <= 64 and _NUMBER.fullmatch(word) else math.nan
        for word in text.split()
    )


def _masses(robot: ET.Element) -> Iterator[tuple[str, tuple[float, Vector]]]:
    """Masses and centres of links; what is no positive finite number is left out."""
    for link in robot.findall("link"):
        with suppress(RobotError):
            (mass,) = _numbers(link, "inertial/mass", "value", (0.0,), "mass")
            if 0 < mass < LIMITS.mass:
                centre = _numbers(
                    link, "inertial/origin", "xyz", (0.0, 0.0, 0.0), "mass"
                )
                yield link.get("name", ""), (mass, centre)


def _find_root(links: Collection[str], joints: tuple[Joint, ...]) -> str:
    """Return the one link without a parent, or say why the links are no tree."""
    above = {joint.child: joint for joint in joints}
    roots = [link for link in links if link not in above]
    reached = list(roots)
    for (
        link
    ) in reached:  # grows as it goes; a link with two parents is reached by one
        reached += [
            j.child for j in joints if j.parent == link and above[j.child] is j
        ]
    faults = {
        f"{len(roots)} root links, join them with fixed joints": roots
        if len(roots) > 1
        else [],
        "joints to a link that has another parent, remove one": [
            joint.name for joint in joints if above[joint.child] is not joint
        ],
        "joints in a loop, remove one": [
            joint.name for joint in joints if joint.child not in reached
        ],
    }
    for fault, names in faults.items():
        if names:
            raise RobotError(
                f"the URDF is no tree of links: {fault}: {listed(names, 4)}"
            )
    return roots[0]
