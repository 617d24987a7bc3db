"""MJCF: a MuJoCo model of hinges and slides, read as the tree of links and joints of a URDF.

A body is a link.  Its joints turn it about their own places in turn::

    body = parent T(body) prod_j T(pos_j) J_j(q_j - ref_j) T(-pos_j)

so that each joint but the last has its own link, and where the last one does not pass through
the body's origin a fixed joint leads on to the body.  Sites are links on fixed joints.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..common.arrays import Array, Range
from ..common.wording import quoted
from ..errors import RobotError
from .mjcf_text import Element, ModelText
from .rigid import rigid
from .robot_text import Attributes, Vector
from .rotations import exponential
from .urdf import Joint, Mimic, Urdf

WORLD = "world"
"""The root link."""

_JOINTS = ("joint", "freejoint")
_ZERO = (0.0, 0.0, 0.0)
_AXES = np.eye(3)


@dataclass(frozen=True, eq=False)
class JointElement:
    """Where the text places a joint: its origin is that of an element, then ``after``."""

    element: int  # its number among all elements, in the order of the text
    after: Array  # (4, 4), from the element to the joint's origin


@dataclass(frozen=True, eq=False)
class Mjcf:
    """A model as a tree of links, and where its text places each joint."""

    tree: Urdf
    # by the names of joints; not of a body's further joints
    places: Mapping[str, JointElement]


@dataclass(frozen=True, eq=False)
class _MovingJoint:
    """A hinge or a slide in its body's frame."""

    name: str
    revolute: bool
    axis: Array  # (3,), of length 1
    place: Array  # (3,) [m]
    reference: float  # [rad or m], value at which the model is drawn
    limits: Range | None  # [rad or m]

    @property
    def pivot(self) -> Array:
        """Transform (4, 4) from the body's frame to the joint's at zero."""
        back = -self.reference * self.axis
        if self.revolute:
            return rigid(exponential(back), self.place)
        return rigid(_AXES, self.place + back)

    def between(self, parent: str, child: str, frame: Array) -> Joint:
        """The joint from one link to another; the body's frame (4, 4) in the first one's."""
        kind = "prismatic"
        if self.revolute:
            kind = "revolute" if self.limits else "continuous"
        axis = tuple(self.axis.tolist())
        origin = frame @ self.pivot
        return Joint(self.name, kind, parent, child, origin, axis, self.limits)


@dataclass
class _Tree:
    """Links and joints as they are read of a model."""

    text: ModelText
    links: list[str] = field(default_factory=lambda: [WORLD])
    joints: list[Joint] = field(default_factory=list)
    masses: dict[str, tuple[float, Vector]] = field(default_factory=dict)
    places: dict[str, JointElement] = field(default_factory=dict)
    # [rad or m], value of each joint at which the model is drawn
    references: dict[str, float] = field(default_factory=dict)

    def add_contents(self, inside: list[Element], link: str) -> None:
        """Add the sites and bodies on a link."""
        for element in inside:
            node = element.node
            if node.tag == "body":
                self._add_body(element, link)
            elif node.tag == "site" and node.get("name"):
                site = self._new_link(self.text.name(element), "site")
                self._fix(f"{site}:site", link, site, element)

    def _add_body(self, element: Element, parent: str) -> None:
        """Add a body with its joints, sites and bodies."""
        node = element.node
        name = self._new_link(self.text.name(element), "body")
        inherited = node.get("childclass", element.inherited)
        inside = [Element(child, inherited) for child in node]
        self._weigh(name, inside)
        moving = [part for part in inside if part.node.tag in _JOINTS]
        if moving:
            self._add_joints(element, moving, parent, name)
        else:
            self._fix(f"{name}:frame", parent, name, element)
        self.add_contents(inside, name)

    def _add_joints(
        self, element: Element, moving: list[Element], parent: str, body: str
    ) -> None:
        """Add the joints between a body's parent and the body."""
        link = parent
        frame = self.text.frame(element)  # the body's, in that of the link
        for part in moving:
            joint = self._moving_joint(part)
            if part is moving[0]:
                self._place(joint.name, element, joint.pivot)
            child = body
            if part is not moving[-1] or joint.place.any():
                child = self._new_link(f"{body}:{joint.name}", "link")
            self.joints.append(joint.between(link, child, frame))
            link = child
            frame = rigid(_AXES, -joint.place)
        if link != body:
            name = f"{body}:frame"
            self.joints.append(Joint(name, "fixed", link, body, frame))

    def _weigh(self, link: str, inside: list[Element]) -> None:
        """Note the mass of a body; NaN, as unknown, where MuJoCo takes it from the geoms."""
        for element in inside:
            if element.node.tag == "inertial":
                stated = Attributes(f"body {quoted(link)}", element.node.attrib)
                centre = stated.numbers("pos", _ZERO)
                self.masses[link] = stated.number("mass"), centre
                return
            if element.node.tag == "geom":
                geom = self.text.attributes(element)
                if geom.get("mass", geom.get("density")) != "0":
                    self.masses[link] = math.nan, _ZERO

    def _fix(
        self, joint: str, parent: str, child: str, element: Element
    ) -> None:
        """Add the fixed joint that carries a site, or a body that has no joints."""
        origin = self.text.frame(element)
        self.joints.append(Joint(joint, "fixed", parent, child, origin))
        self._place(joint, element, np.eye(4))

    def _place(self, joint: str, element: Element, after: Array) -> None:
        number = self.text.numbers[element.node]
        self.places[joint] = JointElement(number, after)

    def _new_link(self, name: str, kind: str) -> str:
        if name in self.links:  # MuJoCo lets a site have a body's name
            name = f"{name}:{kind}"
        if name in self.links:
            raise RobotError(
                f"two of the model's frames are named {quoted(name)}: rename one"
            )
        self.links.append(name)
        return name

    def _moving_joint(self, part: Element) -> _MovingJoint:
        """Check a joint of a body."""
        attributes = self.text.attributes(part)
        where = attributes.where
        name = self.text.name(part)
        kind = attributes.get("type", "hinge")
        if part.node.tag == "freejoint":
            kind = "free"
        if kind not in ("hinge", "slide"):
            raise RobotError(
                f"{where} is of type {quoted(kind)}: expected an arm of hinges and slides; remove "
                "the joint, or the body that it moves"
            )
        if name in self.references:
            raise RobotError(
                f"two joints are named {quoted(name)}: rename one of them"
            )
        axis = np.array(attributes.numbers("axis", (0.0, 0.0, 1.0)))
        length = float(np.linalg.norm(axis))
        if not length > 0:
            raise RobotError(
                f"{where} has the axis 0 0 0: give a direction such as 0 0 1"
            )
        unit = self.text.angle(1.0) if kind == "hinge" else 1.0
        reference = unit * attributes.number("ref")
        self.references[name] = reference
        limited = attributes.get("limited", "auto")
        if limited == "auto" and self.text.autolimits and "range" in attributes:
            limited = "true"
        limits: Range | None = None
        if limited == "true":
            low, high = attributes.numbers("range", (0.0, 0.0))
            limits = unit * low, unit * high
        place = np.array(attributes.numbers("pos", _ZERO))
        return _MovingJoint(
            name, kind == "hinge", axis / length, place, reference, limits
        )


def read_mjcf(root: ET.Element, name: str = "robot") -> Mjcf:
    """Check a MuJoCo model and return its links and joints.

    name : name to use where the model has none
    Raises RobotError: what is wrong or not supported, by name, and what to do.
    """
    tree = _Tree(ModelText.of(root))
    for world in root.findall("worldbody"):
        tree.add_contents([Element(child, "main") for child in world], WORLD)
    if len(tree.links) == 1:
        raise RobotError(
            "the MJCF has no bodies: expected a robot with bodies and joints"
        )
    title = root.get("model", "").strip() or name
    coupled = dict(_couplings(root, tree.references))
    joints = tuple(
        replace(joint, mimic=coupled.get(joint.name)) for joint in tree.joints
    )
    links = tuple(tree.links)
    urdf = Urdf(title, WORLD, links, joints, (), tree.masses)
    return Mjcf(urdf, tree.places)


def _couplings(
    root: ET.Element, references: Mapping[str, float]
) -> Iterator[tuple[str, Mimic]]:
    """Yield the joints that an equality ties to another by a straight line, and what they follow.

    MuJoCo keeps q_1 - ref_1 = a_0 + a_1 (q_2 - ref_2).
    """
    straight = ("0", "1", "0", "0", "0")
    for node in root.findall("equality/joint"):
        name = node.get("joint1", "")
        leader = node.get("joint2", "")
        words = node.get("polycoef", "").split()
        polynomial = Attributes(
            f"the equality of joint {quoted(name)}",
            {"polycoef": " ".join([*words, *straight[len(words) :]])},
        )
        offset, multiplier, *higher = polynomial.numbers("polycoef", (0.0,) * 5)
        both_exist = name in references and leader in references
        if both_exist and node.get("active") != "false" and not any(higher):
            offset += references[name] - multiplier * references[leader]
            yield name, Mimic(leader, multiplier, offset)
