"""Placement: where in space a sensor's positions are, and where it sees points of space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..body.sensor_pose import SensorPose
from ..body.spatial import SpatialStructure
from ..body.views import Placed, is_camera
from ..common.arrays import Array
from ..common.rows import thinned
from ..errors import CalibError
from ..model.model import Model
from ..model.nominal import nominal_in_plane
from .robot import Robot

_PICTURE = (
    "the picture is drawn as far from the camera as the tip is on average"
)
_KNOWN = (
    "the sensor's frame is not the robot's: positions are drawn in the robot's"
)
_NEAR = 0.02  # [m or 1], differences of frames that are not told


@dataclass(frozen=True, eq=False)
class Placement:
    """A projective map from the sensor's plane, or its space, into the robot's root frame."""

    matrix: Array  # (4, m + 1), of a position and one
    note: str = ""  # what the user should be told, or ""
    eye: Array | None = None  # (3,) [m], where a camera stands

    def lift(self, x: ArrayLike) -> Array:
        """Points (n, 3) [m] of the scene for positions (n, m) [unit]."""
        return _mapped(self.matrix, np.asarray(x, dtype=float))

    def drop(self, points: ArrayLike) -> Array:
        """Positions (n, m) [unit] for points (n, 3); what is off a plane is left out."""
        points = np.asarray(points, dtype=float)[..., None]
        depth = self.matrix[3]
        columns = self.matrix[:3] - points * depth
        inverse = np.linalg.pinv(columns[..., :-1])
        return np.asarray(-(inverse @ columns[..., -1:])[..., 0])

    @staticmethod
    def of(origin: Array, axes: Array, note: str = "") -> Placement:
        """The affine map with the sensor's zero at `origin` and its axes (m, 3) per unit."""
        rows = np.vstack([axes, origin])
        last = np.append(np.zeros(len(axes)), 1.0)
        return Placement(np.column_stack([rows, last]).T, note)


def place_model(model: Model, robot: Robot | None) -> Placement:
    """Return where a model's positions are in space."""
    about = model.about
    body = model.body
    origin, axes = _stated_plane(model)
    if (
        robot is None and about.unit == "px"
    ):  # as the camera sees it: y counts downwards
        axes = axes * np.array([[1.0], [-1.0]])
    stated = Placement.of(origin, axes)
    if robot is None or body is None:
        return stated
    sensor = SensorPose.of(body)
    if sensor is None:
        seen = _seen_plane(model)
        if seen is None:
            return stated
        matrix = stated.matrix @ np.linalg.inv(seen)
        near = np.allclose(matrix, stated.matrix, atol=_NEAR)
        return Placement(matrix, "" if near else _KNOWN)
    structure = body.structure
    if not is_camera(structure.view):
        axes = sensor.rotation.T / structure.sensor(body.beta).scale
        note = "" if structure.view == "base" else _KNOWN
        return Placement.of(sensor.position, axes, note)
    # upright across its line of sight
    q = model.motor.weights[model.visited]
    tips = robot.tips(
        np.clip(q[thinned(len(q), 300)], about.lower, about.upper)
    )
    f, u, v, _ = body.beta[structure.groups["lens"]]
    right, down, ahead = sensor.rotation.T
    depth = float(np.mean((tips - sensor.position) @ ahead))
    axes = depth / f * np.array([right, down])
    corner = sensor.position + depth * ahead - np.array([u, v]) @ axes
    return replace(Placement.of(corner, axes, _PICTURE), eye=sensor.position)


def seen_by_sensor(model: Model, points: Array) -> Array | None:
    """Positions (n, 2) [unit] at which a sensor of two coordinates sees points (n, 3) [m]."""
    body = model.body
    if body is None or len(model.axes) != 2:
        return None
    if isinstance(body.structure, SpatialStructure):
        return np.asarray(
            body.structure.sensor(body.beta).look(points.T).values
        )
    seen = _seen_plane(model)
    if seen is None:
        return None
    return _mapped(seen, Placement.of(*_stated_plane(model)).drop(points))


def _stated_plane(model: Model) -> tuple[Array, Array]:
    """Origin (3,) and axes (m, 3) of the plane, or the space, that positions are in."""
    plane = model.about.plane
    if plane is None or len(model.axes) == 3:
        return np.zeros(3), np.eye(3)[: len(model.axes)]
    return np.array(plane["origin"], dtype=float), np.array(
        [plane["x"], plane["y"]]
    )


def _seen_plane(model: Model) -> Array | None:
    """How the sensor of a planar arm sees the plane of its drawing, (3, 3), but for its bend."""
    body = model.body
    try:
        drawn, beta = nominal_in_plane(model, based=True)
    except CalibError:
        return None
    assert body is not None  # noqa: S101 - it has a planar body
    sensor = _homography(body.structure.sensor(body.beta))
    return np.asarray(sensor @ np.linalg.inv(_homography(drawn.sensor(beta))))


def _homography(placed: Placed) -> Array:
    """A planar sensor as a matrix (3, 3)."""
    if placed.lens is None:
        return np.vstack([placed.matrix, [0.0, 0.0, 1.0]])
    size, u, v, _ = placed.lens
    return (
        np.array([[size, 0.0, u], [0.0, size, v], [0.0, 0.0, 1.0]])
        @ placed.matrix
    )


def _mapped(matrix: Array, x: Array) -> Array:
    """Points (n, k) for points (n, m) by a projective map (k + 1, m + 1)."""
    mapped = x @ matrix[:, :-1].T + matrix[:, -1]
    return np.asarray(mapped[..., :-1] / mapped[..., -1:])
