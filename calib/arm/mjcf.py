"""MJCF: a MuJoCo model of hinges and slides, read as the tree of links and joints of a URDF.

A body is a link.  Its joints turn it about their own places in turn::

    body = parent T(body) prod_j T(pos_j) J_j(q_j - ref_j) T(-pos_j)

so that each joint but the last has a link of its own, and where the last one does not pass through
the body's origin a fixed joint leads on to the body.  Sites are links on fixed joints.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..common.arrays import Array
from ..common.wording import quoted
from ..errors import RobotError
from .rotations import exponential, matrix_of
from .urdf import Joint, Rows, Urdf, Vector, as_numbers

WORLD = "world"
"""The root link."""

_ORIENTATIONS = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}
_REFUSED = ("include", "attach", "replicate", "composite", "flexcomp")
_ZERO = (0.0, 0.0, 0.0)

Attributes = Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Placed:
    """The element of the text that places a joint: ``origin = before element after``."""

    element: int  # its number among all elements, in the order of the text
    before: Array  # (4, 4), of the frames around it
    after: Array  # (4, 4), from the element to the joint's origin


@dataclass(frozen=True, eq=False)
class Mjcf:
    """A model as a tree of links, and where its text places each joint."""

    tree: Urdf
    places: Mapping[
        str, Placed
    ]  # by the names of joints; not of a body's further joints


@dataclass
class _Reader:
    """What has been read of a model."""

    numbers: Mapping[ET.Element, int]  # of all elements
    classes: Mapping[str, Mapping[str, Attributes]]  # defaults by class and tag
    degrees: bool
    sequence: str  # axes of Euler angles
    autolimits: bool
    links: list[str] = field(default_factory=lambda: [WORLD])
    joints: list[Joint] = field(default_factory=list)
    masses: dict[str, tuple[float, Vector]] = field(default_factory=dict)
    places: dict[str, Placed] = field(default_factory=dict)

    def attributes(self, node: ET.Element, inherited: str) -> dict[str, str]:
        """Attributes of an element, those of its class among them."""
        name = node.get("class", inherited)
        if name not in self.classes:
            raise RobotError(
                f"<{node.tag}> has the class {quoted(name)}, which does not exist"
            )
        return {**self.classes[name].get(node.tag, {}), **node.attrib}

    def angle(self, value: float) -> float:
        """An angle of the text [rad]."""
        return math.radians(value) if self.degrees else value

    def frame(self, attributes: Attributes, where: str) -> Array:
        """Transform (4, 4) of an element in the frame around it."""
        out = np.eye(4)
        out[:3, :3] = self._orientation(attributes, where)
        out[:3, 3] = _vector(attributes, "pos", _ZERO, where)
        return out

    def _orientation(self, attributes: Attributes, where: str) -> Array:
        """Rotation (3, 3) in any of the forms that MJCF has."""
        forms = [form for form in _ORIENTATIONS if form in attributes]
        if not forms:
            return np.eye(3)
        if len(forms) > 1:
            raise RobotError(
                f"{where} has {' and '.join(forms)}: expected one orientation"
            )
        form = forms[0]
        size = _ORIENTATIONS[form]
        values = np.array(_vector(attributes, form, (math.nan,) * size, where))
        if form == "euler":
            return self._of_euler(values)
        if not np.linalg.norm(values[:3] if form != "quat" else values) > 0:
            raise RobotError(
                f"{where}: {form} is {quoted(attributes[form])}, expected a direction"
            )
        if form == "quat":
            return matrix_of(np.roll(values, -1))
        if form == "axisangle":
            axis = values[:3] / np.linalg.norm(values[:3])
            return exponential(self.angle(float(values[3])) * axis)
        if form == "zaxis":
            return _with_z(values / np.linalg.norm(values))
        x = values[:3] / np.linalg.norm(values[:3])
        y = values[3:] - (values[3:] @ x) * x
        y = y / np.linalg.norm(y)
        return np.column_stack([x, y, np.cross(x, y)])

    def _of_euler(self, angles: Array) -> Array:
        """Rotation (3, 3) of Euler angles; capital letters are turns about fixed axes."""
        rotation = np.eye(3)
        for letter, value in zip(self.sequence, angles.tolist(), strict=True):
            turn = exponential(
                self.angle(value) * np.eye(3)["xyz".index(letter.lower())]
            )
            rotation = rotation @ turn if letter.islower() else turn @ rotation
        return rotation

    def add_body(
        self, node: ET.Element, parent: str, around: Array, inherited: str
    ) -> None:
        """Add a body with its joints, sites and bodies."""
        inherited = node.get("childclass", inherited)
        name = self._new_link(node.get("name") or f"body_{self.numbers[node]}", "body")
        where = f"body {quoted(name)}"
        start = around @ self.frame(node.attrib, where)
        inertial = node.find("inertial")
        if inertial is not None:
            (mass,) = _vector(inertial.attrib, "mass", (0.0,), where)
            if mass > 0:
                self.masses[name] = mass, _vector(inertial.attrib, "pos", _ZERO, where)
        link = parent
        origin = start
        after = np.eye(4)
        inside = list(_unframed(node, self, inherited))
        moving = [
            (child, frame, of) for child, frame, of in inside if child.tag == "joint"
        ]
        for number, (child, frame, of) in enumerate(moving):
            attributes = self.attributes(child, of)
            joint_name = attributes.get("name") or f"joint_{self.numbers[child]}"
            end, back = self._pivot(attributes, frame, joint_name)
            last = number == len(moving) - 1
            whole = last and not back[:3, 3].any()
            beyond = name if whole else self._new_link(f"{name}:{joint_name}", "link")
            self._add_joint(joint_name, link, beyond, origin @ end, attributes, frame)
            if number == 0:
                self.places[joint_name] = Placed(
                    self.numbers[node], around, after @ end
                )
            link = beyond
            origin = back
        if link != name:
            self._add_fixed(f"{name}:frame", link, name, origin)
            if not moving:
                self.places[f"{name}:frame"] = Placed(self.numbers[node], around, after)
        self.add_contents(inside, name)

    def add_contents(
        self, inside: list[tuple[ET.Element, Array, str]], link: str
    ) -> None:
        """Add the sites and bodies on a link."""
        for child, frame, of in inside:
            if child.tag == "body":
                self.add_body(child, link, frame, of)
            elif child.tag == "site" and child.get("name"):
                site = self._new_link(child.get("name", ""), "site")
                placed = frame @ self.frame(
                    self.attributes(child, of), f"site {quoted(site)}"
                )
                self._add_fixed(f"{site}:site", link, site, placed)
                self.places[f"{site}:site"] = Placed(
                    self.numbers[child], frame, np.eye(4)
                )

    def _new_link(self, name: str, kind: str) -> str:
        if name in self.links:  # MuJoCo lets a site have a body's name
            name = f"{name}:{kind}"
        if name in self.links:
            raise RobotError(
                f"two of the model's frames are named {quoted(name)}: rename one"
            )
        self.links.append(name)
        return name

    def _pivot(
        self, attributes: Attributes, frame: Array, name: str
    ) -> tuple[Array, Array]:
        """From a body's frame to that of a joint at zero, and from there on back to the body's."""
        where = f"joint {quoted(name)}"
        place = np.eye(4)
        place[:3, 3] = (
            frame[:3, :3] @ _vector(attributes, "pos", _ZERO, where) + frame[:3, 3]
        )
        back = np.eye(4)
        back[:3, 3] = -place[:3, 3]
        (reference,) = _vector(attributes, "ref", (0.0,), where)
        axis = self._axis(attributes, frame, where)
        if attributes.get("type", "hinge") == "slide":
            place[:3, 3] -= reference * axis
        else:
            place[:3, :3] = exponential(-self.angle(reference) * axis)
        return place, back

    @staticmethod
    def _axis(attributes: Attributes, frame: Array, where: str) -> Array:
        """Unit axis (3,) of a joint in its body's frame."""
        axis = frame[:3, :3] @ np.array(
            _vector(attributes, "axis", (0.0, 0.0, 1.0), where)
        )
        length = float(np.linalg.norm(axis))
        if not length > 0:
            raise RobotError(
                f"{where} has the axis 0 0 0: give a direction such as 0 0 1"
            )
        return np.asarray(axis / length)

    def _add_joint(
        self,
        name: str,
        parent: str,
        child: str,
        origin: Array,
        attributes: Attributes,
        frame: Array,
    ) -> None:
        where = f"joint {quoted(name)}"
        kind = attributes.get("type", "hinge")
        if kind not in ("hinge", "slide"):
            raise RobotError(
                f"{where} is of type {quoted(kind)}: expected hinges and slides alone"
            )
        if any(joint.name == name for joint in self.joints):
            raise RobotError(f"two joints are named {quoted(name)}: rename one of them")
        limits = None
        limited = attributes.get("limited", "auto")
        if limited == "true" or (
            limited == "auto" and self.autolimits and "range" in attributes
        ):
            low, high = _vector(attributes, "range", (0.0, 0.0), where)
            limits = (
                (self.angle(low), self.angle(high)) if kind == "hinge" else (low, high)
            )
        turning = "continuous" if limits is None else "revolute"
        self.joints.append(
            Joint(
                name=name,
                kind=turning if kind == "hinge" else "prismatic",
                parent=parent,
                child=child,
                xyz=tuple(origin[:3, 3].tolist()),
                rotation=_rows(origin),
                axis=tuple(self._axis(attributes, frame, where).tolist()),
                limits=limits,
                mimic=None,
            )
        )

    def _add_fixed(self, name: str, parent: str, child: str, origin: Array) -> None:
        xyz = tuple(origin[:3, 3].tolist())
        joint = Joint(
            name,
            "fixed",
            parent,
            child,
            xyz,
            _rows(origin),
            (1.0, 0.0, 0.0),
            None,
            None,
        )
        self.joints.append(joint)


def read_mjcf(root: ET.Element, name: str = "robot") -> Mjcf:
    """Check a MuJoCo model and return its links and joints.

    name : name to use where the model has none
    Raises RobotError: what is wrong or not supported, by name, and what to do.
    """
    for node in root.iter():
        if node.tag in _REFUSED:
            said = node.get("file") or node.get("name") or node.get("model") or ""
            raise RobotError(
                f"the MJCF has <{node.tag}> {quoted(said)}: expected one file that is written out, "
                "as `mujoco.mj_saveLastXML` writes it"
            )
        ball = node.tag == "joint" and node.get("type") in ("free", "ball")
        if node.tag == "freejoint" or ball:
            kind = node.get("type", "free")
            raise RobotError(
                f"joint {quoted(node.get('name', ''))} is a {kind} joint: expected an arm of "
                "hinges and slides; remove the joint, or the body that it moves"
            )
    compiler: dict[str, str] = {}
    for node in root.findall("compiler"):
        compiler.update(node.attrib)
    if compiler.get("coordinate", "local") != "local":
        raise RobotError(
            "the MJCF has global coordinates: save it anew with MuJoCo 2.3 or later"
        )
    sequence = compiler.get("eulerseq", "xyz")
    if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
        raise RobotError(
            f"the MJCF's eulerseq is {quoted(sequence)}: expected such as xyz"
        )
    reader = _Reader(
        numbers={node: number for number, node in enumerate(root.iter())},
        classes=_classes(root),
        degrees=compiler.get("angle", "degree") == "degree",
        sequence=sequence,
        autolimits=compiler.get("autolimits", "true") == "true",
    )
    for world in root.findall("worldbody"):
        reader.add_contents(list(_unframed(world, reader, "main")), WORLD)
    if len(reader.links) == 1:
        raise RobotError(
            "the MJCF has no bodies: expected a robot with bodies and joints"
        )
    joints = tuple(reader.joints)
    title = root.get("model", "").strip() or name
    tree = Urdf(title, WORLD, tuple(reader.links), joints, (), dict(reader.masses))
    return Mjcf(tree, reader.places)


def _classes(root: ET.Element) -> dict[str, dict[str, Attributes]]:
    """Attributes of elements by class and tag, with those of the classes around it."""
    classes: dict[str, dict[str, Attributes]] = {"main": {}}

    def add(node: ET.Element, name: str, around: Mapping[str, Attributes]) -> None:
        known = {**around, **classes.get(name, {})}
        for child in node:
            if child.tag != "default":
                known[child.tag] = {**known.get(child.tag, {}), **child.attrib}
        classes[name] = known
        for child in node.findall("default"):
            add(child, child.get("class", ""), known)

    for node in root.findall("default"):
        add(node, node.get("class", "main"), {})
    return classes


def _unframed(
    node: ET.Element, reader: _Reader, inherited: str
) -> Iterator[tuple[ET.Element, Array, str]]:
    """Elements of a body, in frames within it too: each with its frame (4, 4) and its class."""

    def within(
        node: ET.Element, frame: Array, inherited: str
    ) -> Iterator[tuple[ET.Element, Array, str]]:
        for child in node:
            if child.tag == "frame":
                placed = frame @ reader.frame(child.attrib, "a frame")
                yield from within(child, placed, child.get("childclass", inherited))
            else:
                yield child, frame, inherited

    yield from within(node, np.eye(4), inherited)


def _vector(attributes: Attributes, key: str, default: Vector, where: str) -> Vector:
    """Numbers of an attribute."""
    text = attributes.get(key)
    if text is None:
        return default
    values = as_numbers(text)
    if len(values) != len(default) or not all(map(math.isfinite, values)):
        raise RobotError(
            f"{where}: {key} is {quoted(text)}, expected {len(default)} numbers"
        )
    return values


def _with_z(axis: Array) -> Array:
    """The shortest rotation (3, 3) that turns z to a unit axis."""
    about = np.array([-axis[1], axis[0], 0.0])
    sine = float(np.linalg.norm(about))
    if sine < 1e-10:
        return np.eye(3) if axis[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return exponential(math.atan2(sine, float(axis[2])) / sine * about)


def _rows(origin: Array) -> Rows:
    """Rows of the orientation of a transform (4, 4)."""
    first, second, third = (tuple(row) for row in origin[:3, :3].tolist())
    return first, second, third
