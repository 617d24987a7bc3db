"""Placement: where in space positions and joints are drawn, and from where they are seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...arm.plane import Plane, fit_plane
from ...arm.rotations import similarity
from ...body.spatial import SpatialStructure
from ...body.views import is_camera
from ...common.arrays import Array
from ...common.rows import thinned
from ...errors import CalibError
from ..workspace import downwards, extent

if TYPE_CHECKING:
    from ...model.model import Model
    from .arm import DrawnArm

_TRUSTED = 0.15  # a sensor that differs less [share of the extent] is drawn where it says
_SIZES = (0.05, 20.0)  # extents [m] that are drawn as they are
_DRAWN = 0.6  # extent of all others
_AZIMUTH = np.radians(-60.0)  # from where a scene in space is seen


@dataclass(frozen=True, eq=False)
class Placement:
    """An affine map from the sensor's plane, or its space, into the scene."""

    origin: Array  # (3,), where the sensor's (0, 0) is
    axes: Array  # (2, 3) or (3, 3), where its x and y, and in space its z, lead, for one unit
    # size of the scene over that of the world, not 1 only for very small or large arms and for
    # sensors with units of their own
    scale: float
    note: str = ""  # what the user should be told, or ""
    up: float = 1.0  # sign of y that leads up a picture: -1 where it counts downwards, as pixels do

    def lift(self, x: ArrayLike) -> Array:
        """Points (n, 3) of the scene for positions (n, 2) or (n, 3) [unit]."""
        return np.asarray(self.origin + np.asarray(x, dtype=float) @ self.axes)

    @property
    def frame(self) -> Array:
        """Rows x, y (upwards) and normal of the drawn plane, unit vectors (3, 3).

        In space it is the upright plane that the viewer faces, from the front and the right.
        """
        if len(self.axes) == 3:
            return np.array(
                [
                    [-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0],
                    [0.0, 0.0, 1.0],
                    [np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0],
                ]
            )
        x = self.axes[0] / np.linalg.norm(self.axes[0])
        normal = np.cross(self.axes[0], self.up * self.axes[1])
        normal /= np.linalg.norm(normal)
        return np.stack([x, np.cross(normal, x), normal])


def place_model(model: Model, body: DrawnArm | None) -> Placement:
    """Find where a model's positions are in space.

    A sensor whose pose the model's body knows is drawn where it stands, a camera's picture as far
    from it as the tip is.  Other positions are drawn where they say, if they agree with the robot's
    own geometry; else the similarity that fits best brings them to the robot, with a note.
    """
    about, size, own = model.about, extent(model), model.body
    up, structure = -1.0 if downwards(about.unit) else 1.0, getattr(own, "structure", None)
    if own is not None and body is not None and isinstance(structure, SpatialStructure):
        sensor = structure.sensor(own.beta) if structure.informed else None
        # x = scale R p + shift, seen from the root link
        turn = np.eye(3) if sensor is None else sensor.rotation
        place = np.zeros(3) if sensor is None else -sensor.shift @ turn / sensor.scale
        if sensor is not None and is_camera(structure.view):
            f, u, v, _ = sensor.lens
            depth = float(np.mean((body.tips(_nodes(model)) - place) @ turn[2]))
            axes = depth / f * turn[:2]
            corner = place + depth * turn[2] - u * axes[0] - v * axes[1]
            note = "the picture is drawn as far from the camera as the tip is on average"
            return Placement(corner, axes, 1.0, note, -1.0)
        unit = 1.0 if sensor is None else sensor.scale
        scale = _scale_of(size / unit)
        note = "the sensor's frame is not the robot's: positions are drawn in the robot's"
        note = note if sensor is not None and structure.view != "base" else ""
        return Placement(scale * place, scale * turn / unit, scale, note)
    if body is None or len(model.axes) == 3:
        scale, plane = _scale_of(size), _stated(about.plane)
        # as the camera sees it
        axes = np.eye(3) if len(model.axes) == 3 else np.stack([plane.x, up * plane.y])
        return Placement(scale * plane.origin, scale * axes, scale, up=up)
    nodes = _nodes(model)
    learned = model.forward(nodes)
    known = np.isfinite(learned).all(axis=1)
    tips, learned = body.tips(nodes[known]), learned[known]
    try:
        plane = fit_plane(tips)[0]
    except CalibError:
        plane = _stated(about.plane)
    nominal = plane.project(tips)
    reach = float(np.ptp(nominal, axis=0).max())
    scale = _scale_of(reach)
    linear, shift, note = np.eye(2), np.zeros(2), ""
    far = np.sqrt(np.mean(np.sum((learned - nominal) ** 2, axis=1)))
    if about.unit != "m" or far > _TRUSTED * reach:
        # a camera may see the arm mirrored
        turn, shift, factor = similarity(learned, nominal, mirrored=True)
        linear = factor * turn.T
        note = (
            "the sensor's frame is not the robot's: its positions are drawn where a least-squares "
            "fit (turn, mirror, scale, shift) brings them"
        )
    basis = np.stack([plane.x, plane.y])
    return Placement(scale * plane.lift(shift), scale * linear @ basis, scale, note, up)


def _nodes(model: Model) -> Array:
    """Joints (n, dof) [rad or m] of visited nodes: the others stand where nothing was measured."""
    nodes = model.motor.scale.from_unit(np.clip(model.motor.units[model.visited], 0.0, 1.0))
    return np.asarray(nodes[thinned(len(nodes), 300)])


def _scale_of(size: float) -> float:
    """Scale at which an extent [m] is drawn: its own, unless it is very small or very large."""
    # meshcat's grid, near plane and mouse wheel are made for some decimetres to some metres
    return 1.0 if _SIZES[0] <= size <= _SIZES[1] else _DRAWN / size


def _stated(plane: object) -> Plane:
    if isinstance(plane, dict):
        return Plane(*(np.array(plane[key], dtype=float) for key in ("origin", "x", "y")))
    return Plane(np.zeros(3), np.eye(3)[0], np.eye(3)[1])


_FIELD_OF_VIEW = 35.0  # degrees, from bottom to top
_TILT = math.radians(24.0)  # off the plane's normal, so that depth can be seen
_MARGIN = 1.05
_UPRIGHT = 0.75  # cosine of normal and vertical; planes above it are seen from above


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A perspective camera that shows a box of the scene whatever the window's shape."""

    target: Array  # (3,), middle of the picture
    direction: Array  # (3,), unit vector from there to the camera
    half: Array  # (3,), half the extent of what is shown, along right, up and depth

    @staticmethod
    def onto(points: Array, frame: Array) -> Viewpoint:
        """Camera that shows points (n, 3) and looks onto a plane of axes `frame` (3, 3)."""
        normal, up = frame[2], np.array([0.0, 0.0, 1.0])
        if abs(normal @ up) > _UPRIGHT:
            # from above, y leading up the screen
            normal = normal * math.copysign(1.0, normal @ up)
            direction = math.cos(_TILT) * normal - math.sin(_TILT) * frame[1]
        else:
            direction = math.cos(_TILT) * normal + math.sin(_TILT) * up
        direction = direction / np.linalg.norm(direction)
        axes = _axes(direction)
        seen = points @ axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        return Viewpoint((low + high) / 2 @ axes, direction, (high - low) / 2)

    def to_json(self) -> dict[str, Any]:
        """Plain data for the page, which computes the same."""
        return {
            "target": self.target.tolist(),
            "direction": self.direction.tolist(),
            "half": self.half.tolist(),
            "fov": _FIELD_OF_VIEW,
            "margin": _MARGIN,
        }


def _axes(direction: Array) -> Array:
    """Rows right, up and towards the camera (3, 3); the scene's z leads upwards."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])
