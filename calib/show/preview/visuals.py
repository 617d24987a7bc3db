"""Visuals: the shapes that a URDF gives its links."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .body import transform

Array = NDArray[np.float64]

GREY = "#8a929b"
_SIZES = {"box": 3, "cylinder": 2, "capsule": 2, "sphere": 1, "mesh": 0}


@dataclass(frozen=True, eq=False)
class Visual:
    """One shape of a link."""

    link: str
    kind: str  # "box", "cylinder", "sphere" or "mesh"
    # [m], sides of a box; radius and length of a cylinder; radius of a sphere
    size: tuple[float, ...]
    origin: Array  # (4, 4), where it is in the link's frame
    colour: str  # as ``#rrggbb``
    opacity: float = 1.0  # 1 for solid
    mesh: str = ""  # file name as the URDF has it
    scale: Array = field(default_factory=lambda: np.ones(3))  # (3,), of a mesh


def visuals(text: str) -> list[Visual]:
    """Read the shapes of a URDF that has been checked; what cannot be read is left out."""
    robot = ET.fromstring(text)  # noqa: S314 - parse_urdf has refused DTDs before
    palette = {
        node.get("name", ""): colour
        for node in robot.iter("material")
        if (colour := _colour(node)) is not None
    }
    found: list[Visual] = []
    for link in robot.findall("link"):
        for node in link.findall("visual"):
            found += _shapes(link.get("name", ""), node, palette)
    return found


def _shapes(link: str, node: ET.Element, palette: dict[str, tuple[str, float]]) -> Iterator[Visual]:
    material = node.find("material")
    colour = (GREY, 1.0)
    if material is not None:
        colour = _colour(material) or palette.get(material.get("name", ""), colour)
    geometry = node.find("geometry")
    for shape in geometry if geometry is not None else ():
        try:
            origin = _origin(node.find("origin"))
            size, scale = _size(shape), _numbers(shape.get("scale", "1 1 1"), 3)
        except (ValueError, KeyError):
            continue
        kind = "cylinder" if shape.tag == "capsule" else shape.tag
        yield Visual(link, kind, size, origin, *colour, shape.get("filename", ""), scale)


def _size(shape: ET.Element) -> tuple[float, ...]:
    count = _SIZES[shape.tag]
    if shape.tag == "box":
        size = _numbers(shape.get("size", ""), 3)
    else:
        keys = ("radius", "length")[:count]
        size = _numbers(" ".join(shape.get(key, "?") for key in keys), count)
    if (size <= 0).any():
        raise ValueError("a shape without extent")
    return tuple(size.tolist())


def _origin(node: ET.Element | None) -> Array:
    if node is None:
        return np.eye(4)
    return transform(_numbers(node.get("xyz", "0 0 0"), 3), _numbers(node.get("rpy", "0 0 0"), 3))


def _numbers(text: str, count: int) -> Array:
    values = np.array([float(part) for part in text.split()], dtype=float)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ValueError(f"{text!r}: expected {count} numbers")
    return values


def _colour(material: ET.Element) -> tuple[str, float] | None:
    node = material.find("color")
    if node is None:
        return None
    try:
        red, green, blue, alpha = np.clip(_numbers(node.get("rgba", ""), 4), 0.0, 1.0)
    except ValueError:
        return None
    parts = (round(255 * float(c)) for c in (red, green, blue))
    return "#" + "".join(f"{part:02x}" for part in parts), float(alpha)
