"""Description: a robot's text as a checked tree of links and joints, whatever its format."""

from __future__ import annotations

from functools import lru_cache

from .mjcf import read_mjcf
from .robot_text import MJCF, parse_xml
from .urdf import Urdf, read_urdf_tree


@lru_cache(maxsize=4)
def parse_robot(text: str, name: str = "robot") -> Urdf:
    """Check the text of a URDF or an MJCF and return its links and joints.

    name : name to use where the text gives its robot none
    Raises RobotError: what is wrong, what was expected and what to do.
    """
    root = parse_xml(text)
    if root.tag == MJCF:
        return read_mjcf(root, name).tree
    return read_urdf_tree(root, name)
