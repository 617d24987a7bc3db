"""MJCF text: elements that are refused, defaults of classes, equalities between joints."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping

from ..common.wording import quoted
from ..errors import RobotError
from .robot_text import Attributes
from .urdf import Mimic

Defaults = Mapping[str, Mapping[str, str]]
"""Attributes of elements by their tag."""

REFUSED = (
    "include",
    "attach",
    "frame",
    "replicate",
    "composite",
    "flexcomp",
)
"""Elements that stand for others, or for a part of their places."""


def check_supported(node: ET.Element) -> None:
    """Refuse an element that stands for others."""
    if node.tag in REFUSED:
        name = node.get("file") or node.get("name") or node.get("model") or ""
        raise RobotError(
            f"the MJCF has <{node.tag}> {quoted(name)}: expected one file that is written out, "
            "as `mujoco.mj_saveLastXML` writes it"
        )


def couplings(
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


def defaults_by_class(root: ET.Element) -> dict[str, Defaults]:
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
