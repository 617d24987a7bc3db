"""Arm: where a robot's links are, and their shapes on the canvas, or a skeleton in their place."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...arm.loading import held_values
from ...arm.posture import Kinematics
from ...arm.tree import Urdf
from ...arm.urdf import parse_urdf
from ...common.arrays import Array
from ...errors import CalibError
from ...model.about import About
from .canvas import Canvas
from .mesh import read_mesh, resolve_mesh

LAYER = "Arm"
_BONE, _JOINT, _GREY = "#e0853c", "#59636e", "#8a929b"
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""From three.js, whose cylinders stand along y, to URDF, where they stand along z."""


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """The links of a robot, moved by its active joints."""

    urdf: Urdf  # the checked tree
    text: str  # its own text
    kinematics: Kinematics
    joint_names: tuple[str, ...]  # active joints, base to tip
    tip: str  # the link whose position is sensed
    locked: Mapping[str, float]  # [rad or m], other joints; those not named are neutral

    @staticmethod
    def of(about: About) -> DrawnArm | None:
        """Return the arm of a model's robot, None where no URDF came with it."""
        if not about.urdf or not about.tip:
            return None
        try:
            urdf = parse_urdf(about.urdf, about.robot)
            kinematics = Kinematics(urdf)
        except CalibError:
            return None
        return DrawnArm(urdf, about.urdf, kinematics, about.joint_names, about.tip, about.locked)

    def poses(self, q: ArrayLike) -> dict[str, Array]:
        """Transforms (n, 4, 4) of every link in the root's frame, for joints (n, dof)."""
        rows = np.atleast_2d(np.asarray(q, dtype=float)).tolist()
        posed = [{**self.locked, **dict(zip(self.joint_names, row, strict=True))} for row in rows]
        found = [self.kinematics.transforms(held_values(self.urdf, values)) for values in posed]
        return {link: np.stack([each[link] for each in found]) for link in self.urdf.links}

    def tips(self, q: ArrayLike) -> Array:
        """Position (n, 3) of the tip in the root's frame [m]."""
        return np.asarray(self.poses(q)[self.tip][:, :3, 3])

    @cached_property
    def way(self) -> tuple[str, ...]:
        """Links from the root to the tip."""
        return (self.urdf.root, *(joint.child for joint in self.urdf.path(self.tip)))

    def draw(
        self, canvas: Canvas, poses: Mapping[str, Array], size: float, meshes: Path | None
    ) -> list[str]:
        """Draw the robot moving through poses; return what could not be drawn, for the user.

        poses : mapping of str to (n, 4, 4) array, transforms of its links
        size : [m], the workspace's extent, which tells how thick bones are
        meshes : the folder that mesh files may be taken from
        """
        notes: dict[str, None] = {}
        drawn = set()
        for number, (link, kind, origin, style) in enumerate(shapes(self.text)):
            if link not in poses:
                continue
            path = f"{LAYER}/{link}/shape {number + 1}"
            if kind == "mesh":
                if meshes is None:
                    notes["the robot's shape is in mesh files: give their folder as `meshes`"] = (
                        None
                    )
                    continue
                try:
                    points, faces = read_mesh(resolve_mesh(style.pop("file"), meshes))
                except (CalibError, OSError) as error:
                    notes[f"not drawn: {error}"] = None
                    continue
                style |= {"points": points * style.pop("scale"), "index": faces}
            canvas.add(path, kind, **style)
            canvas.place(path, origin @ _UPRIGHT if kind == "cylinder" else origin)
            drawn.add(link)
        if not drawn & set(self.way[1:]):
            self._draw_skeleton(canvas, poses, size)
            drawn |= set(self.way)
        for link in drawn:
            canvas.place(f"{LAYER}/{link}", poses[link])
        return list(notes)

    def _draw_skeleton(self, canvas: Canvas, poses: Mapping[str, Array], size: float) -> None:
        """Bones from each link on the way to the tip to the next, and balls between them."""
        for link, following in zip(self.way, [*self.way[1:], self.way[-1]], strict=True):
            canvas.add(f"{LAYER}/{link}/joint", "sphere", _JOINT, size=[0.02 * size])
            # in the frame of the link that carries it, so that it moves along
            end = (np.linalg.inv(poses[link][0]) @ poses[following][0])[:3, 3]
            length = float(np.linalg.norm(end))
            if length > 1e-3 * size:
                path = f"{LAYER}/{link}/bone"
                canvas.add(path, "cylinder", _BONE, size=[0.012 * size, length])
                canvas.place(path, _along(end))


def _along(end: Array) -> Array:
    """Transform of a cylinder along y so that it leads from the origin to `end` (3,)."""
    y = end / np.linalg.norm(end)
    x = np.cross(np.eye(3)[np.argmin(np.abs(y))], y)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, y, np.cross(x, y)], axis=1)
    matrix[:3, 3] = end / 2
    return matrix


_SIZES = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": (),
}


def shapes(text: str) -> Iterator[tuple[str, str, Array, dict[str, Any]]]:
    """Yield link, kind, place (4, 4) in the link and looks of each shape of a checked URDF.

    Shapes that cannot be read are left out.
    """
    robot = ET.fromstring(text)  # noqa: S314 - parse_urdf has refused DTDs before
    named = {node.get("name"): found for node in robot.iter("material") if (found := _colour(node))}
    for link in robot.findall("link"):
        for node in link.findall("visual"):
            material = node.find("material")
            look = None
            if material is not None:
                look = _colour(material) or named.get(material.get("name"))
            for shape in node.findall("geometry/*"):
                with suppress(ValueError, KeyError):
                    style = {**(look or {"colour": _GREY}), **_shape(shape)}
                    kind = "cylinder" if shape.tag == "capsule" else shape.tag
                    yield link.get("name", ""), kind, _place(node.find("origin")), style


def _shape(shape: ET.Element) -> dict[str, Any]:
    """Size of a shape, file and scale of a mesh; a ValueError or KeyError where it has none."""
    if shape.tag == "mesh":
        scale = _numbers(shape.get("scale", "1 1 1"), 3).astype(np.float32)
        return {"file": shape.get("filename", ""), "scale": scale}
    keys = _SIZES[shape.tag]
    text = " ".join(shape.get(key, "?") for key in keys)
    size = _numbers(text, 3 if shape.tag == "box" else len(keys))
    if (size <= 0).any():
        raise ValueError("a shape without extent")
    return {"size": size.tolist()}


def _place(origin: ET.Element | None) -> Array:
    place = np.eye(4)
    if origin is not None:
        from scipy.spatial.transform import Rotation

        # roll, pitch and yaw turn about fixed axes
        turn = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"), 3))
        place[:3, :3], place[:3, 3] = turn.as_matrix(), _numbers(origin.get("xyz", "0 0 0"), 3)
    return place


def _numbers(text: str, count: int) -> Array:
    values = np.array([float(part) for part in text.split()], dtype=float)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ValueError(f"{text!r}: expected {count} numbers")
    return values


def _colour(material: ET.Element) -> dict[str, Any] | None:
    node = material.find("color")
    with suppress(ValueError):
        if node is not None:
            *rgb, alpha = np.clip(_numbers(node.get("rgba", ""), 4), 0.0, 1.0).tolist()
            hue = "#" + "".join(f"{round(255 * part):02x}" for part in rgb)
            return {"colour": hue, "opacity": alpha}
    return None
