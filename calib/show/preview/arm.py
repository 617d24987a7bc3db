"""Arm: a robot's shapes on the canvas, or its skeleton where it has none."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import CalibError
from .body import Body
from .canvas import Canvas
from .meshes import read_mesh, resolve_mesh
from .visuals import Visual, visuals

Array = NDArray[np.float64]

LAYER = "Arm"
_BONE, _JOINT = "#e0853c", "#59636e"
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""From three.js, whose cylinders stand along y, to URDF, where they stand along z."""


def draw_arm(
    canvas: Canvas, body: Body, poses: Mapping[str, Array], size: float, meshes: Path | None
) -> tuple[str, ...]:
    """Draw a robot at a posture; return what could not be drawn, for the user.

    poses : mapping of str to (n, 4, 4) array, transforms of its links; the first row is drawn
    size : [m], the workspace's extent, which tells how thick bones are
    meshes : the folder that mesh files may be taken from
    """
    shapes = visuals(body.text)
    notes: list[str] = []
    drawn = set()
    if any(shape.kind == "mesh" for shape in shapes) and meshes is None:
        notes.append("the robot's shape is in mesh files: give their folder as `meshes`")
    for number, shape in enumerate(shapes):
        if shape.link not in poses:
            continue
        if _draw_shape(canvas, f"{LAYER}/{shape.link}/shape {number + 1}", shape, meshes, notes):
            drawn.add(shape.link)
    moving = [link for link in body.way if link in poses]
    if not drawn & set(moving[1:]):
        _draw_skeleton(canvas, body, poses, size)
    for link, transforms in poses.items():
        if link in drawn or link in moving:
            canvas.place(f"{LAYER}/{link}", transforms[0])
    return tuple(dict.fromkeys(notes))


def _draw_shape(
    canvas: Canvas, path: str, shape: Visual, meshes: Path | None, notes: list[str]
) -> bool:
    origin = shape.origin
    if shape.kind == "mesh":
        if meshes is None:
            return False
        try:
            mesh = read_mesh(resolve_mesh(shape.mesh, meshes))
        except (CalibError, OSError) as error:
            notes.append(f"not drawn: {error}")
            return False
        vertices = mesh.vertices * shape.scale.astype(np.float32)
        canvas.mesh(path, vertices, mesh.faces, shape.colour, shape.opacity)
    elif shape.kind == "box":
        canvas.box(path, shape.size, shape.colour, shape.opacity)
    elif shape.kind == "sphere":
        canvas.sphere(path, shape.size[0], shape.colour, shape.opacity)
    else:
        canvas.cylinder(path, shape.size[0], shape.size[1], shape.colour, shape.opacity)
        origin = origin @ _UPRIGHT
    canvas.place(path, origin)
    return True


def _draw_skeleton(canvas: Canvas, body: Body, poses: Mapping[str, Array], size: float) -> None:
    """Bones from each link on the way to the tip to the next, and balls between them."""
    way = body.way
    for link, following in zip(way, [*way[1:], None], strict=True):
        canvas.sphere(f"{LAYER}/{link}/joint", 0.02 * size, _JOINT)
        if following is None:
            continue
        # in the frame of the link that carries it, so that it moves along
        here = np.linalg.inv(poses[link][0]) @ poses[following][0]
        end = here[:3, 3]
        length = float(np.linalg.norm(end))
        if length < 1e-3 * size:
            continue
        canvas.cylinder(f"{LAYER}/{link}/bone", 0.012 * size, length, _BONE)
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
