"""Corrected MJCF: a copy of the text whose bodies and sites stand where the arm really has them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from ..arm.mjcf import Mjcf, read_mjcf
from ..arm.posture import origin_of
from ..arm.rotations import quaternion_of
from ..arm.urdf import parse_xml
from ..common.arrays import Array
from ..common.wording import quoted
from ..errors import RobotError

_TINY = 1e-12  # [m or rad]; a smaller change is rounding
_SAME = 1e-9  # of an origin's numbers: what rounding of a quaternion leaves
_PLACING = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")
_TAG = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")


def corrected_mjcf(text: str, model: Mjcf, origins: Mapping[str, Array]) -> str:
    """A model's text with bodies and sites placed so that joints have other origins (4, 4).

    Only the attributes that place them are rewritten; all else stays as it was.  Raises RobotError
    where a joint that has moved is a body's second one, which its body's place does not move alone.
    """
    moved: dict[int, Array] = {}
    for name, origin in origins.items():
        joint = model.tree.joint(name)
        if joint is None or np.abs(origin_of(joint) - origin).max() <= _TINY:
            continue
        placed = model.places.get(name)
        if placed is None:
            raise RobotError(
                f"joint {quoted(name)} shares its body with another joint: give it a body of its "
                "own, whose place can be corrected"
            )
        moved[placed.element] = (
            np.linalg.inv(placed.before) @ origin @ np.linalg.inv(placed.after)
        )
    corrected = _with_places(text, moved)
    tree = read_mjcf(parse_xml(corrected)).tree
    for name, origin in origins.items():
        joint = tree.joint(name)
        if joint is None or np.abs(origin_of(joint) - origin).max() > _SAME:
            raise RobotError(
                f"joint {quoted(name)} reads back with another origin than was written"
            )
    return corrected


def _with_places(text: str, moved: Mapping[int, Array]) -> str:
    """The text with elements, by their number in it, placed by transforms (4, 4)."""
    data = text.encode()
    elements: list[
        tuple[int, dict[str, str]]
    ] = []  # where each begins, and its attributes
    reader = expat.ParserCreate("utf-8")

    def start(_: str, attributes: dict[str, str]) -> None:
        elements.append((reader.CurrentByteIndex, attributes))

    reader.StartElementHandler = start
    reader.Parse(data, True)
    for number in sorted(moved, reverse=True):
        begin, attributes = elements[number]
        tag = _TAG.match(data, begin)
        assert tag is not None  # noqa: S101 - expat found one here
        x, y, z, w = quaternion_of(moved[number][:3, :3]).tolist()
        new = {key: value for key, value in attributes.items() if key not in _PLACING}
        new["pos"] = _numbers(*moved[number][:3, 3].tolist())
        new["quat"] = _numbers(w, x, y, z)
        inside = " ".join(f"{key}={quoteattr(value)}" for key, value in new.items())
        name = re.match(rb"<([^\s/>]+)", tag[0])
        assert name is not None  # noqa: S101 - a tag has a name
        end = "/>" if tag[0].endswith(b"/>") else ">"
        data = data[:begin] + name[0] + f" {inside}{end}".encode() + data[tag.end() :]
    return data.decode()


def _numbers(*values: float) -> str:
    return " ".join(repr(value + 0.0) for value in values)
