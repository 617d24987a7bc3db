"""Placement: where in space a sensor's positions are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..body.sensor_pose import SensorPose
from ..body.views import Placed, is_camera
from ..common.arrays import Array
from ..errors import CalibError
from ..model.model import Model
from ..model.nominal import nominal_in_plane, visited_joints
from .robot import Robot


@dataclass(frozen=True, eq=False)
class Placement:
    """A projective map from the sensor's plane, or its space, into the robot's root frame."""

    matrix: Array  # (4, m + 1), of a position and one
    eye: Array | None = None  # (3,) [m], where a camera stands

    def lift(self, x: ArrayLike) -> Array:
        """Points (n, 3) [m] of the scene for positions (n, m) [unit]."""
        mapped = np.asarray(x, dtype=float) @ self.matrix[:, :-1].T
        mapped += self.matrix[:, -1]
        return mapped[..., :-1] / mapped[..., -1:]

    @staticmethod
    def of(origin: Array, axes: Array, eye: Array | None = None) -> Placement:
        """The affine map with the sensor's zero at `origin` and its axes (m, 3) per unit."""
        rows = np.vstack([axes, origin])
        last = np.append(np.zeros(len(axes)), 1.0)
        return Placement(np.column_stack([rows, last]).T, eye)


def place_model(model: Model, robot: Robot | None) -> Placement:
    """Return where a model's positions are in space."""
    about = model.about
    body = model.body
    origin = np.zeros(3)
    axes = np.eye(3)[: len(model.axes)]
    if about.plane is not None and len(model.axes) == 2:
        origin = np.array(about.plane["origin"], dtype=float)
        axes = np.array([about.plane["x"], about.plane["y"]])
    if robot is None and about.unit == "px":
        axes[1] *= -1.0  # as the camera sees it: y counts downwards
    stated = Placement.of(origin, axes)
    if robot is None or body is None:
        return stated
    sensor = SensorPose.of(body)
    if sensor is None:
        return Placement(stated.matrix @ _seen_in_drawing(model))
    structure = body.structure
    if not is_camera(structure.view):
        scaled = sensor.rotation.T / structure.sensor(body.beta).scale
        return Placement.of(sensor.position, scaled)
    # upright across its line of sight, as far from the camera as the tip is on average
    tips = robot.tips(visited_joints(model, 300))
    f, u, v, _ = body.beta[structure.groups["lens"]]
    right, down, ahead = sensor.rotation.T
    depth = float(np.mean((tips - sensor.position) @ ahead))
    axes = depth / f * np.array([right, down])
    corner = sensor.position + depth * ahead - np.array([u, v]) @ axes
    return Placement.of(corner, axes, sensor.position)


def _seen_in_drawing(model: Model) -> Array:
    """From what a planar arm's sensor sees, but for its bend, to its drawing's plane (3, 3)."""
    body = model.body
    try:
        drawn, beta = nominal_in_plane(model, based=True)
    except CalibError:
        return np.eye(3)
    assert body is not None  # noqa: S101 - it has a planar body
    sensor = _homography(body.structure.sensor(body.beta))
    return _homography(drawn.sensor(beta)) @ np.linalg.inv(sensor)


def _homography(placed: Placed) -> Array:
    """A planar sensor as a matrix (3, 3)."""
    if placed.lens is None:
        return np.vstack([placed.matrix, [0.0, 0.0, 1.0]])
    size, u, v, _ = placed.lens
    camera = np.array([[size, 0.0, u], [0.0, size, v], [0.0, 0.0, 1.0]])
    return camera @ placed.matrix
