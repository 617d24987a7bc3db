"""MJCF: a MuJoCo model of hinges and slides, read as the tree of links and joints of a URDF.

A body is a link.  Its joints turn it about their own places in turn::

    body = parent T(body) prod_j T(pos_j) J_j(q_j - ref_j) T(-pos_j)

so that each joint but the last has a link of its own, and where the last one does not pass through
the body's origin a fixed joint leads on to the body.  Sites are links on fixed joints.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array
from ..common.wording import quoted
from ..errors import RobotError
from .mjcf_text import (
    Defaults,
    check_supported,
    couplings,
    defaults_by_class,
)
from .robot_text import Attributes, Vector
from .rotations import exponential, matrix_of
from .urdf import Joint, Range, Urdf

WORLD = "world"
"""The root link."""

_JOINTS = ("joint", "freejoint")
_ORIENTATIONS = {"quat": 4, "axisangle": 4, "xyaxes": 6, "euler": 3}
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


class Element(NamedTuple):
    """An element of a body."""

    node: ET.Element
    inherited: str  # class of its defaults


@dataclass(frozen=True)
class _Reader:
    """The settings of a model, and what has been read of it."""

    numbers: Mapping[ET.Element, int]  # of all elements
    classes: Mapping[str, Defaults]
    degrees: bool
    sequence: str  # axes of Euler angles
    autolimits: bool
    links: list[str] = field(default_factory=lambda: [WORLD])
    joints: list[Joint] = field(default_factory=list)
    masses: dict[str, tuple[float, Vector]] = field(default_factory=dict)
    places: dict[str, JointElement] = field(default_factory=dict)
    # [rad or m], value of each joint at which the model is drawn
    references: dict[str, float] = field(default_factory=dict)

    def name(self, element: Element) -> str:
        """Name of an element, by its number where it has none."""
        node = element.node
        return node.get("name") or f"{node.tag}_{self.numbers[node]}"

    def attributes(self, element: Element) -> Attributes:
        """Attributes of an element, those of its class among them."""
        node = element.node
        where = f"{node.tag} {quoted(self.name(element))}"
        name = node.get("class", element.inherited)
        if name not in self.classes:
            raise RobotError(
                f"{where} has the class {quoted(name)}, which does not exist"
            )
        defaults = self.classes[name].get(node.tag, {})
        return Attributes(where, {**defaults, **node.attrib})

    def angle(self, value: float) -> float:
        """An angle of the text [rad]."""
        return math.radians(value) if self.degrees else value

    def frame(self, element: Element) -> Array:
        """Transform (4, 4) of an element in its body's frame, a body's in its parent's."""
        attributes = self.attributes(element)
        place = attributes.numbers("pos", _ZERO)
        return _transform(self._orientation(attributes), place)

    def _orientation(self, attributes: Attributes) -> Array:
        """Rotation (3, 3) in any of the forms that MJCF has."""
        where = attributes.where
        if "zaxis" in attributes:
            raise RobotError(
                f"{where} has a zaxis: expected quat, axisangle, xyaxes or euler"
            )
        forms = [form for form in _ORIENTATIONS if form in attributes]
        if not forms:
            return _AXES
        if len(forms) > 1:
            raise RobotError(
                f"{where} has {' and '.join(forms)}: expected one orientation"
            )
        form = forms[0]
        nothing = (math.nan,) * _ORIENTATIONS[form]
        values = np.array(attributes.numbers(form, nothing))
        if form == "euler":
            return self._of_euler(values)
        direction = values if form == "quat" else values[:3]
        length = np.linalg.norm(direction)
        if not length > 0:
            raise RobotError(
                f"{where}: {form} is {quoted(attributes[form])}, expected a direction"
            )
        direction = direction / length
        if form == "quat":
            return matrix_of(np.roll(direction, -1))
        if form == "axisangle":
            return exponential(self.angle(float(values[3])) * direction)
        y = values[3:] - (values[3:] @ direction) * direction
        y = y / np.linalg.norm(y)
        return np.column_stack([direction, y, np.cross(direction, y)])

    def _of_euler(self, angles: Array) -> Array:
        """Rotation (3, 3) of Euler angles; capital letters are turns about fixed axes."""
        rotation = _AXES
        for letter, value in zip(self.sequence, angles.tolist(), strict=True):
            axis = _AXES["xyz".index(letter.lower())]
            turn = exponential(self.angle(value) * axis)
            rotation = rotation @ turn if letter.islower() else turn @ rotation
        return rotation

    def add_contents(self, inside: list[Element], link: str) -> None:
        """Add the sites and bodies on a link."""
        for element in inside:
            node = element.node
            if node.tag == "body":
                self._add_body(element, link)
            elif node.tag == "site" and node.get("name"):
                site = self._new_link(self.name(element), "site")
                self._fix(f"{site}:site", link, site, element)

    def _add_body(self, element: Element, parent: str) -> None:
        """Add a body with its joints, sites and bodies."""
        node = element.node
        name = self._new_link(self.name(element), "body")
        origin = self.frame(element)
        inherited = node.get("childclass", element.inherited)
        inside = [Element(child, inherited) for child in node]
        self._weigh(name, inside)
        moving = [part for part in inside if part.node.tag in _JOINTS]
        if not moving:
            self._fix(f"{name}:frame", parent, name, element)
        link = parent
        for part in moving:
            joint, back = self._joint(part, link)
            if part is moving[0]:
                self._place(joint.name, element, joint.origin)
            link = name
            if part is not moving[-1] or back[:3, 3].any():
                link = self._new_link(f"{name}:{joint.name}", "link")
            place = origin @ joint.origin
            self.joints.append(replace(joint, child=link, origin=place))
            origin = back
        if moving and link != name:
            frame = f"{name}:frame"
            self.joints.append(Joint(frame, "fixed", link, name, origin))
        self.add_contents(inside, name)

    def _weigh(self, link: str, inside: list[Element]) -> None:
        """Note the mass of a body; of one that MuJoCo weighs by its geoms it is unknown, NaN."""
        for element in inside:
            if element.node.tag == "inertial":
                stated = Attributes(f"body {quoted(link)}", element.node.attrib)
                centre = stated.numbers("pos", _ZERO)
                self.masses[link] = stated.number("mass"), centre
                return
            if element.node.tag == "geom":
                geom = self.attributes(element)
                if geom.get("mass", geom.get("density")) != "0":
                    self.masses[link] = math.nan, _ZERO

    def _fix(
        self,
        joint: str,
        parent: str,
        child: str,
        element: Element,
    ) -> None:
        """Add the fixed joint that carries a site, or a body that has no joints."""
        origin = self.frame(element)
        self.joints.append(Joint(joint, "fixed", parent, child, origin))
        self._place(joint, element, np.eye(4))

    def _place(self, joint: str, element: Element, after: Array) -> None:
        number = self.numbers[element.node]
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

    def _joint(self, part: Element, parent: str) -> tuple[Joint, Array]:
        """Return a joint at zero in its body's frame, and the way (4, 4) back to that frame."""
        attributes = self.attributes(part)
        where = attributes.where
        name = self.name(part)
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
        axis = axis / length
        place = np.array(attributes.numbers("pos", _ZERO))
        back = _transform(_AXES, -place)
        pivot = _transform(_AXES, place)
        unit = self.angle(1.0) if kind == "hinge" else 1.0
        reference = unit * attributes.number("ref")
        self.references[name] = reference
        limited = attributes.get("limited", "auto")
        if limited == "auto" and self.autolimits and "range" in attributes:
            limited = "true"
        limits: Range | None = None
        if limited == "true":
            low, high = attributes.numbers("range", (0.0, 0.0))
            limits = unit * low, unit * high
        if kind == "slide":
            kind = "prismatic"
            pivot[:3, 3] -= reference * axis
        else:
            kind = "revolute" if limits else "continuous"
            pivot[:3, :3] = exponential(-reference * axis)
        direction = tuple(axis.tolist())
        return Joint(name, kind, parent, "", pivot, direction, limits), back


def read_mjcf(root: ET.Element, name: str = "robot") -> Mjcf:
    """Check a MuJoCo model and return its links and joints.

    name : name to use where the model has none
    Raises RobotError: what is wrong or not supported, by name, and what to do.
    """
    for node in root.iter():
        check_supported(node)
    compiler: dict[str, str] = {}
    for node in root.findall("compiler"):
        compiler.update(node.attrib)
    sequence = compiler.get("eulerseq", "xyz")
    if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
        raise RobotError(
            f"the MJCF's eulerseq is {quoted(sequence)}: expected such as xyz"
        )
    reader = _Reader(
        numbers={node: number for number, node in enumerate(root.iter())},
        classes=defaults_by_class(root),
        degrees=compiler.get("angle", "degree") == "degree",
        sequence=sequence,
        autolimits=compiler.get("autolimits", "true") == "true",
    )
    for world in root.findall("worldbody"):
        reader.add_contents([Element(child, "main") for child in world], WORLD)
    if len(reader.links) == 1:
        raise RobotError(
            "the MJCF has no bodies: expected a robot with bodies and joints"
        )
    title = root.get("model", "").strip() or name
    coupled = dict(couplings(root, reader.references))
    joints = tuple(
        replace(joint, mimic=coupled.get(joint.name)) for joint in reader.joints
    )
    links = tuple(reader.links)
    tree = Urdf(title, WORLD, links, joints, (), reader.masses)
    return Mjcf(tree, reader.places)


def _transform(rotation: Array, place: Array | Vector) -> Array:
    """Transform (4, 4) of a rotation (3, 3) and a place (3,)."""
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = place
    return transform
