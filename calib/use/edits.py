"""Edits of a robot's text that give its joints other origins; all else stays as it was."""

import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from ..arm.mjcf import read_mjcf
from ..arm.robot_text import MJCF, parse_xml
from ..arm.rotations import quaternion_of
from ..common.arrays import Array
from ..common.wording import quoted
from ..errors import RobotError

_TAG = re.compile(rb"<([^\s/>]+)(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")
_PLACING = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")

Edits = dict[int, tuple[Mapping[str, str], str]]
"""Attributes of some tags and a text behind them, by the number of the element in the text."""


def with_origins(text: str, origins: Mapping[str, Array]) -> str:
    """Return a URDF or MJCF whose joints have these origins (4, 4).

    Raises RobotError where a joint of an MJCF is its body's second one, which its body's place does
    not move alone.
    """
    root = parse_xml(text)
    edits = _mjcf_edits if root.tag == MJCF else _urdf_edits
    data = text.encode()
    begins: list[int] = []
    reader = expat.ParserCreate("utf-8")
    reader.StartElementHandler = lambda *_: begins.append(
        reader.CurrentByteIndex
    )
    reader.Parse(data, True)
    for number, (attributes, behind) in sorted(
        edits(root, origins).items(), reverse=True
    ):
        old = _TAG.match(data, begins[number])
        assert old is not None  # noqa: S101 - expat found a tag here
        end = "/>" if old[0].endswith(b"/>") else ">"
        new = _start_of_tag(old[1].decode(), attributes) + end + behind
        data = data[: old.start()] + new.encode() + data[old.end() :]
    return data.decode()


def _start_of_tag(name: str, attributes: Mapping[str, str]) -> str:
    """Return the text of a tag but for its end."""
    parts = [f"{key}={quoteattr(value)}" for key, value in attributes.items()]
    return " ".join([f"<{name}", *parts])


def number_text(values: Iterable[float]) -> str:
    """Return numbers of an attribute, in full."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def _urdf_edits(root: ET.Element, origins: Mapping[str, Array]) -> Edits:
    from scipy.spatial.transform import Rotation

    index = {node: number for number, node in enumerate(root.iter())}
    edits: Edits = {}
    for joint in root.findall("joint"):
        if joint.get("name") not in origins:
            continue
        frame = origins[joint.get("name", "")]
        # at a pitch of 90 deg SciPy sets one of the others to zero
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            angles = Rotation.from_matrix(frame[:3, :3]).as_euler("xyz")
        change = {"xyz": number_text(frame[:3, 3]), "rpy": number_text(angles)}
        origin = joint.find("origin")
        if origin is None:
            behind = _start_of_tag("origin", change) + "/>"
            edits[index[joint]] = (joint.attrib, behind)
        else:
            edits[index[origin]] = ({**origin.attrib, **change}, "")
    return edits


def _mjcf_edits(root: ET.Element, origins: Mapping[str, Array]) -> Edits:
    """Return what places bodies and sites so that joints have these origins."""
    places = read_mjcf(root).places
    nodes = list(root.iter())
    edits: Edits = {}
    for name, origin in origins.items():
        place = places.get(name)
        if place is None:
            raise RobotError(
                f"joint {quoted(name)} shares its body with another joint: give it a body of its "
                "own, whose place can be corrected"
            )
        frame = origin @ np.linalg.inv(place.after)
        attributes = dict(nodes[place.element].attrib)
        for key in _PLACING:
            attributes.pop(key, None)
        edits[place.element] = (attributes | pose_of(frame), "")
    return edits


def pose_of(frame: Array) -> dict[str, str]:
    """Return a place (4, 4) as the attributes of a body in MuJoCo."""
    x, y, z, w = quaternion_of(frame[:3, :3]).tolist()
    return {"pos": number_text(frame[:3, 3]), "quat": number_text([w, x, y, z])}
