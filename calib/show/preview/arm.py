"""Arm: where a robot's links are, and their shapes on the canvas, or a skeleton in their place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
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

LAYER = "Arm"
_BONE, _JOINT, _GREY = "#e0853c", "#59636e", (0.54, 0.57, 0.61)
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

    def draw(self, canvas: Canvas, poses: Mapping[str, Array], size: float) -> None:
        """Draw the robot moving through poses, transforms (n, 4, 4) of its links."""
        drawn = set()
        for number, (link, kind, origin, style) in enumerate(shapes(self.text)):
            if link not in poses:
                continue
            path = f"{LAYER}/{link}/shape {number + 1}"
            canvas.add(path, kind, **style)
            canvas.place(path, origin @ _UPRIGHT if kind == "cylinder" else origin)
            drawn.add(link)
        if not drawn & set(self.way[1:]):
            self._draw_skeleton(canvas, poses, size)
            drawn |= set(self.way)
        for link in drawn:
            canvas.place(f"{LAYER}/{link}", poses[link])

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
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.align_vectors([end], [[0.0, 1.0, 0.0]])[0].as_matrix()
    matrix[:3, 3] = end / 2
    return matrix


def shapes(text: str) -> Iterator[tuple[str, str, Array, dict[str, Any]]]:
    """Yield link, kind, place (4, 4) in the link and looks of each shape of a checked URDF."""
    import yourdfpy

    try:
        how: dict[str, Any] = {"build_scene_graph": False, "load_meshes": False}
        robot = yourdfpy.URDF.load(BytesIO(text.encode()), **how).robot
    except (AttributeError, KeyError, TypeError, ValueError):  # whatever its parser raises
        return
    materials = [*robot.materials, *(v.material for link in robot.links for v in link.visuals)]
    named = {m.name: m.color for m in materials if m is not None and m.color is not None}
    for link in robot.links:
        for visual in link.visuals:
            place = np.eye(4) if visual.origin is None else np.asarray(visual.origin)
            hue = None if visual.material is None else named.get(visual.material.name)
            rgba = np.array([*_GREY, 1.0] if hue is None else hue.rgba, dtype=float)
            colour = "#" + bytes(np.round(255 * rgba[:3].clip(0, 1)).astype(np.uint8)).hex()
            style: dict[str, Any] = {"colour": colour, "opacity": float(rgba[3].clip(0, 1))}
            shape = visual.geometry
            sizes = {
                "box": shape.box and shape.box.size,
                "cylinder": shape.cylinder and (shape.cylinder.radius, shape.cylinder.length),
                "sphere": shape.sphere and (shape.sphere.radius,),
            }
            for kind, size in sizes.items():
                if size is not None and (np.isfinite(size) & (np.array(size) > 0)).all():
                    yield link.name, kind, place, {**style, "size": np.ravel(size).tolist()}
