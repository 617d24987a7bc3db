"""Tree: the links and joints of a robot, once its URDF has been checked."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from functools import cached_property

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
        return tuple(self._below.get(link, ()))

    def carries(self, link: str) -> bool:
        """Whether some movable joint lies beyond a link."""
        return link in self._carrying

    @cached_property
    def _above(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def _below(self) -> dict[str, list[Joint]]:
        below: dict[str, list[Joint]] = {}
        for joint in self.joints:
            below.setdefault(joint.parent, []).append(joint)
        return below

    @cached_property
    def _carrying(self) -> set[str]:
        carrying: set[str] = set()
        for joint in self.joints:
            link = joint.parent
            while joint.movable and link not in carrying:
                carrying.add(link)
                link = self._above[link].parent if link in self._above else link
        return carrying

    def numbered(self) -> Urdf:
        """Return the same tree with numbers in its names, in the same order.

        A stranger's names may mean something to Pinocchio: it calls the world `universe`.
        """
        links = {link: f"link_{k}" for k, link in enumerate(self.links)}
        joints = tuple(
            replace(joint, name=f"joint_{k}", parent=links[joint.parent], child=links[joint.child])
            for k, joint in enumerate(self.joints)
        )
        return replace(self, root=links[self.root], links=tuple(links.values()), joints=joints)

    def plain(self) -> str:
        """Return a URDF of links and joints only, which Pinocchio reads without objection.

        Continuous joints are written as revolute ones, so that every joint has one value.
        """
        robot = ET.Element("robot", name="robot")
        for link in self.links:
            ET.SubElement(robot, "link", name=link)
        for joint in self.joints:
            kind = "revolute" if joint.kind == "continuous" else joint.kind
            node = ET.SubElement(robot, "joint", name=joint.name, type=kind)
            ET.SubElement(node, "parent", link=joint.parent)
            ET.SubElement(node, "child", link=joint.child)
            ET.SubElement(node, "origin", xyz=_written(joint.xyz), rpy=_written(joint.rpy))
            if joint.movable:
                ET.SubElement(node, "axis", xyz=_written(joint.axis))
                ET.SubElement(node, "limit", lower="-1", upper="1", effort="0", velocity="0")
        return ET.tostring(robot, encoding="unicode")


def _written(vector: Vector) -> str:
    return " ".join(map(repr, vector))
