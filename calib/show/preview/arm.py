"""Arm: where a robot's links are, and their shapes on the canvas, or a skeleton in their place."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
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
from .meshes import read_mesh, resolve_mesh

LAYER = "Arm"
_BONE, _JOINT = "#e0853c", "#59636e"
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""From three.js, whose cylinders stand along y, to URDF, where they stand along z."""


def draw_arm(
    canvas: Canvas, body: DrawnArm, poses: Mapping[str, Array], size: float, meshes: Path | None
) -> tuple[str, ...]:
    """Draw a robot at a posture; return what could not be drawn, for the user.

    poses : mapping of str to (n, 4, 4) array, transforms of its links; the first row is drawn
    size : [m], the workspace's extent, which tells how thick bones are
    meshes : the folder that mesh files may be taken from
    """
    notes: dict[str, None] = {}
    drawn = set()
    for number, shape in enumerate(visuals(body.text)):
        if shape.link not in poses:
            continue
        path = f"{LAYER}/{shape.link}/shape {number + 1}"
        style: dict[str, Any] = {"size": shape.size, "opacity": shape.opacity}
        points = faces = None
        if shape.kind == "mesh":
            if meshes is None:
                notes["the robot's shape is in mesh files: give their folder as `meshes`"] = None
                continue
            try:
                mesh = read_mesh(resolve_mesh(shape.mesh, meshes))
            except (CalibError, OSError) as error:
                notes[f"not drawn: {error}"] = None
                continue
            points, faces = mesh.vertices * shape.scale.astype(np.float32), mesh.faces
        canvas.add(path, shape.kind, shape.colour, points, faces, **style)
        canvas.place(path, shape.origin @ _UPRIGHT if shape.kind == "cylinder" else shape.origin)
        drawn.add(shape.link)
    moving = [link for link in body.way if link in poses]
    if not drawn & set(moving[1:]):
        _draw_skeleton(canvas, body, poses, size)
    for link, transforms in poses.items():
        if link in drawn or link in moving:
            canvas.place(f"{LAYER}/{link}", transforms[0])
    return tuple(notes)


def _draw_skeleton(canvas: Canvas, body: DrawnArm, poses: Mapping[str, Array], size: float) -> None:
    """Bones from each link on the way to the tip to the next, and balls between them."""
    way = body.way
    for link, following in zip(way, [*way[1:], None], strict=True):
        canvas.add(f"{LAYER}/{link}/joint", "sphere", _JOINT, size=[0.02 * size])
        if following is None:
            continue
        # in the frame of the link that carries it, so that it moves along
        here = np.linalg.inv(poses[link][0]) @ poses[following][0]
        end = here[:3, 3]
        length = float(np.linalg.norm(end))
        if length < 1e-3 * size:
            continue
        canvas.add(f"{LAYER}/{link}/bone", "cylinder", _BONE, size=[0.012 * size, length])
        canvas.place(f"{LAYER}/{link}/bone", _along(end))


def _along(end: Array) -> Array:
    """Transform of a cylinder along y so that it leads from the origin to `end` (3,)."""
    y = end / np.linalg.norm(end)
    helper = np.eye(3)[np.argmin(np.abs(y))]
    x = np.cross(helper, y)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, y, np.cross(x, y)], axis=1)
    matrix[:3, 3] = end / 2
    return matrix


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
        """Return the body of a model's robot, None where no URDF came with it."""
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


_GREY = "#8a929b"
_SIZES = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": (),
}


@dataclass(frozen=True, eq=False)
class Visual:
    """One shape of a link."""

    link: str
    kind: str  # "box", "cylinder", "sphere" or "mesh"
    # [m], sides of a box; radius and length of a cylinder; radius of a sphere
    size: tuple[float, ...]
    origin: Array  # (4, 4), where it is in the link's frame
    colour: str  # as ``#rrggbb``
    opacity: float  # 1 for solid
    mesh: str  # file name as the URDF has it
    scale: Array  # (3,), of a mesh


def visuals(text: str) -> list[Visual]:
    """Read the shapes of a URDF that has been checked; what cannot be read is left out."""
    robot = ET.fromstring(text)  # noqa: S314 - parse_urdf has refused DTDs before
    named = {node.get("name", ""): _colour(node) for node in robot.iter("material") if len(node)}
    found: list[Visual] = []
    for link in robot.findall("link"):
        for node in link.findall("visual"):
            material = node.find("material")
            colour = None
            if material is not None:
                colour = _colour(material) or named.get(material.get("name", ""))
            for shape in node.findall("geometry/*"):
                with suppress(ValueError, KeyError):
                    name, about = link.get("name", ""), _shape(shape, node.find("origin"))
                    mesh = shape.get("filename", ""), _numbers(shape.get("scale", "1 1 1"), 3)
                    found.append(Visual(name, *about, *(colour or (_GREY, 1.0)), *mesh))
    return found


def _shape(shape: ET.Element, origin: ET.Element | None) -> tuple[str, tuple[float, ...], Array]:
    """Kind, size and place of a shape; a ValueError or KeyError where it has none."""
    keys = _SIZES[shape.tag]
    text = " ".join(shape.get(key, "?") for key in keys)
    size = _numbers(text, 3 if shape.tag == "box" else len(keys))
    if (size <= 0).any():
        raise ValueError("a shape without extent")
    place = np.eye(4)
    if origin is not None:
        from scipy.spatial.transform import Rotation

        # roll, pitch and yaw turn about fixed axes
        turn = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"), 3))
        place[:3, :3], place[:3, 3] = turn.as_matrix(), _numbers(origin.get("xyz", "0 0 0"), 3)
    return "cylinder" if shape.tag == "capsule" else shape.tag, tuple(size.tolist()), place


def _numbers(text: str, count: int) -> Array:
    values = np.array([float(part) for part in text.split()], dtype=float)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ValueError(f"{text!r}: expected {count} numbers")
    return values


def _colour(material: ET.Element) -> tuple[str, float] | None:
    node = material.find("color")
    with suppress(ValueError):
        if node is not None:
            *rgb, alpha = np.clip(_numbers(node.get("rgba", ""), 4), 0.0, 1.0).tolist()
            return "#" + "".join(f"{round(255 * part):02x}" for part in rgb), alpha
    return None
