"""Placement: where in space positions are drawn, and from where they are seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...arm.rotations import similarity
from ...body.sensor_pose import SensorPose
from ...body.views import is_camera
from ...common.arrays import Array
from ...common.rows import thinned
from ...model.model import Model
from ..robot import Robot

# a sensor that differs less [share of the extent] is drawn where it says
_TRUSTED = 0.15
_AZIMUTH = math.radians(-60.0)  # from where a scene in space is seen
_FIELD_OF_VIEW = 35.0  # degrees, from bottom to top
_TILT = math.radians(24.0)  # off the plane's normal, so that depth can be seen
_MARGIN = 1.1
_UPRIGHT = 0.75  # cosine of normal and vertical; planes above it are seen from above
_PICTURE = "the picture is drawn as far from the camera as the tip is on average"
_KNOWN = "the sensor's frame is not the robot's: positions are drawn in the robot's"
_FITTED = (
    "the sensor's frame is not the robot's: its positions are drawn where a least-squares "
    "fit (turn, mirror, scale, shift) brings them"
)


@dataclass(frozen=True, eq=False)
class Placement:
    """An affine map from the sensor's plane, or its space, into the scene."""

    origin: Array  # (3,), where the sensor's (0, 0) is
    axes: Array  # (2, 3) or (3, 3), where its x and y, and in space its z, lead, for one unit
    up: float = 1.0  # sign of y that leads up a picture: -1 where it counts downwards, as pixels do
    note: str = ""  # what the user should be told, or ""

    def lift(self, x: ArrayLike) -> Array:
        """Points (n, 3) of the scene for positions (n, 2) or (n, 3) [unit]."""
        return np.asarray(self.origin + np.asarray(x, dtype=float) @ self.axes)

    @property
    def frame(self) -> Array:
        """Rows x, y (upwards) and normal of the drawn plane, unit vectors (3, 3)."""
        if len(self.axes) == 3:
            c = np.cos(_AZIMUTH)
            s = np.sin(_AZIMUTH)
            return np.array([[-s, c, 0.0], [0.0, 0.0, 1.0], [c, s, 0.0]])
        x = self.axes[0] / np.linalg.norm(self.axes[0])
        normal = np.cross(self.axes[0], self.up * self.axes[1])
        normal /= np.linalg.norm(normal)
        return np.stack([x, np.cross(normal, x), normal])


def place_model(model: Model, arm: Robot | None) -> Placement:
    """Find where a model's positions are in space."""
    about = model.about
    plane = about.plane
    up = -1.0 if about.unit == "px" else 1.0
    # where positions say that they are, in the root link's frame
    axes = np.eye(3)[: len(model.axes)]
    origin = np.zeros(3)
    if plane and len(axes) == 2:
        axes = np.array([plane["x"], plane["y"]])
        origin = np.array(plane["origin"], dtype=float)
    if arm is None:  # as the camera sees it
        return Placement(origin, axes * np.array([[1.0], [up], [1.0]])[: len(axes)], up)
    nodes = model.motor.scale.from_unit(
        np.clip(model.motor.units[model.visited], 0.0, 1.0)
    )
    nodes = nodes[thinned(len(nodes), 300)]
    x = model.forward(nodes)
    answered = np.isfinite(x).all(axis=1)
    x = x[answered]
    tips = arm.tips(nodes[answered])
    sensor = SensorPose.of(model.body)
    body = model.body
    if (
        sensor is not None and body is not None
    ):  # the body knows where the sensor stands
        structure: Any = body.structure
        if is_camera(structure.view):  # upright across its line of sight
            f, u, v, _ = body.beta[structure.groups["lens"]]
            depth = float(np.mean((tips - sensor.position) @ sensor.rotation[:, 2]))
            axes = depth / f * sensor.rotation[:, :2].T
            corner = (
                sensor.position
                + depth * sensor.rotation[:, 2]
                - u * axes[0]
                - v * axes[1]
            )
            return Placement(corner, axes, -1.0, _PICTURE)
        axes = sensor.rotation.T / structure.sensor(body.beta).scale
        return Placement(
            sensor.position, axes, up, "" if structure.view == "base" else _KNOWN
        )
    stated = origin + x @ axes
    far = np.sqrt(np.mean(np.sum((stated - tips) ** 2, axis=1)))
    if about.unit != "m" or far > _TRUSTED * float(np.ptp(tips, axis=0).max()):
        # points of a plane need no mirror: a half turn about a line in it is one
        turn, shift, factor = similarity(stated, tips)
        return Placement(
            factor * turn @ origin + shift, factor * axes @ turn.T, up, _FITTED
        )
    return Placement(origin, axes, up)


def camera_onto(points: Array, frame: Array) -> dict[str, Any]:
    """A perspective camera that shows points (n, 3) of a plane (3, 3), as the page computes it.

    Returns "target", middle of the picture, "direction", unit vector from there to the camera,
    "half", half the extent of what is shown along right, up and depth, "fov" and "margin".
    """
    normal = frame[2]
    up = np.array([0.0, 0.0, 1.0])
    towards = up
    if abs(normal @ up) > _UPRIGHT:  # from above, y leading up the screen
        normal = normal * math.copysign(1.0, normal @ up)
        towards = -frame[1]
    direction = math.cos(_TILT) * normal + math.sin(_TILT) * towards
    direction = direction / np.linalg.norm(direction)
    right = np.cross(up, direction)
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(direction, right), direction])
    box = points @ axes.T
    low = box.min(axis=0)
    high = box.max(axis=0)
    parts = {
        "target": (low + high) / 2 @ axes,
        "direction": direction,
        "half": (high - low) / 2,
    }
    plain = {name: values.tolist() for name, values in parts.items()}
    return {**plain, "fov": _FIELD_OF_VIEW, "margin": _MARGIN}
