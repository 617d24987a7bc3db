"""Corrected MJCF: bodies and sites that stand where the arm really has them."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np

from ..arm.mjcf import read_mjcf
from ..arm.rotations import quaternion_of
from ..common.arrays import Array
from ..common.wording import quoted
from ..errors import RobotError
from .xml_text import Attributes, numbers

_PLACING = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")


def mjcf_edits(
    root: ET.Element, moved: Mapping[str, Array]
) -> dict[int, tuple[Attributes, str]]:
    """Return what places bodies and sites so that joints have other origins (4, 4).

    Raises RobotError where a joint that has moved is a body's second one, which its body's place
    does not move alone.
    """
    places = read_mjcf(root).places
    edits: dict[int, tuple[Attributes, str]] = {}
    for name, origin in moved.items():
        place = places.get(name)
        if place is None:
            raise RobotError(
                f"joint {quoted(name)} shares its body with another joint: give it a body of its "
                "own, whose place can be corrected"
            )
        frame = origin @ np.linalg.inv(place.after)
        x, y, z, w = quaternion_of(frame[:3, :3]).tolist()
        for element, node in enumerate(root.iter()):
            if (node.tag, node.get("name")) == (place.tag, place.name):
                attributes = {
                    key: value
                    for key, value in node.attrib.items()
                    if key not in _PLACING
                }
                attributes["pos"] = numbers(frame[:3, 3])
                attributes["quat"] = numbers([w, x, y, z])
                edits[element] = (attributes, "")
    return edits
