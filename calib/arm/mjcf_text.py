"""MJCF text: the elements of a MuJoCo model, their names, attributes and frames."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array
from ..common.wording import quoted
from ..errors import RobotError
from .rigid import rigid
from .robot_text import Attributes
from .rotations import exponential, matrix_of

Defaults = Mapping[str, Mapping[str, str]]
"""Attributes of elements by their tag."""

_REFUSED = ("include", "attach", "frame", "replicate", "composite", "flexcomp")
"""Elements that are expanded to others, or to a part of their places."""

_ORIENTATIONS = {"quat": 4, "axisangle": 4, "xyaxes": 6, "euler": 3}
_AXES = np.eye(3)


class Element(NamedTuple):
    """An element of a body."""

    node: ET.Element
    inherited: str  # class of its defaults


@dataclass(frozen=True)
class ModelText:
    """A model's elements, and the settings by which they are read."""

    numbers: Mapping[ET.Element, int]  # of all elements
    classes: Mapping[str, Defaults]
    degrees: bool
    sequence: str  # axes of Euler angles
    autolimits: bool

    @staticmethod
    def of(root: ET.Element) -> ModelText:
        """Check a model's root element.

        Raises RobotError if it holds elements that are expanded to others.
        """
        for node in root.iter():
            _check_supported(node)
        compiler: dict[str, str] = {}
        for node in root.findall("compiler"):
            compiler.update(node.attrib)
        sequence = compiler.get("eulerseq", "xyz")
        if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
            raise RobotError(
                f"the MJCF's eulerseq is {quoted(sequence)}: expected such as xyz"
            )
        return ModelText(
            numbers={node: number for number, node in enumerate(root.iter())},
            classes=_defaults_by_class(root),
            degrees=compiler.get("angle", "degree") == "degree",
            sequence=sequence,
            autolimits=compiler.get("autolimits", "true") == "true",
        )

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
        place = attributes.numbers("pos", (0.0, 0.0, 0.0))
        return rigid(self._orientation(attributes), place)

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


def _check_supported(node: ET.Element) -> None:
    """Refuse an element that is expanded to others."""
    if node.tag in _REFUSED:
        name = node.get("file") or node.get("name") or node.get("model") or ""
        raise RobotError(
            f"the MJCF has <{node.tag}> {quoted(name)}: expected one file that is written out, "
            "as `mujoco.mj_saveLastXML` writes it"
        )


def _defaults_by_class(root: ET.Element) -> dict[str, Defaults]:
    """Defaults of each class, with those of the classes around it."""
    classes: dict[str, Defaults] = {"main": {}}

    def add(node: ET.Element, name: str, around: Defaults) -> None:
        defaults = {**around, **classes.get(name, {})}
        for child in node:
            before = defaults.get(child.tag, {})
            defaults[child.tag] = {**before, **child.attrib}
        classes[name] = defaults
        for child in node.findall("default"):
            add(child, child.get("class", ""), defaults)

    for node in root.findall("default"):
        add(node, node.get("class", "main"), {})
    return classes
