"""Placement: where in space a sensor's positions are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..body.sensor_pose import SensorPose
from ..common.arrays import Array
from ..common.rows import finite_rows
from ..common.scale import Scale
from ..model.model import Model
from ..model.nominal import visited_joints
from ..model.space import Space
from .robot import Robot


@dataclass(frozen=True, eq=False)
class Placement:
    """A projective map from a sensor's plane, or its space, into the robot's root frame."""

    scale: Scale  # of the sensor's positions
    matrix: Array  # (4, m + 1), of a position in the unit box and one

    def lift(self, x: ArrayLike) -> Array:
        """Points (n, 3) [m] of the scene for positions (n, m) [unit]."""
        u = self.scale.to_unit(np.asarray(x, float))
        mapped = u @ self.matrix[:, :-1].T + self.matrix[:, -1]
        return mapped[..., :-1] / mapped[..., -1:]


def place_model(model: Model, robot: Robot | None) -> Placement:
    """Return where a model's positions are in space: where the arm is when it reads them."""
    q = visited_joints(model, 300)
    x = model.forward(q)
    if robot is None:
        points = np.column_stack([x, np.zeros(len(x))])[:, :3]
        if model.about.unit == "px":
            points[:, 1] *= -1.0  # as the camera sees it: y counts downwards
    elif SensorPose.of(model.body) is None:
        points = robot.tips(q)
    else:
        points = Space.of(model).forward(q)[0]
    answered = finite_rows(x) & finite_rows(points)
    scale = model.sensory.scale
    return _projective(scale, scale.to_unit(x[answered]), points[answered])


def _projective(scale: Scale, u: Array, points: Array) -> Placement:
    """Fit the map from u (n, m) in the unit box to points (n, 3) by direct linear transform.

    Of p (1 + h'u) = M (u, 1), which is linear in M and h, the least sum of squares is left.
    """
    p = points.T
    of_matrix = np.kron(np.eye(3), np.column_stack([u, np.ones(len(u))]))
    of_horizon = -p.reshape(-1, 1) * np.tile(u, (3, 1))
    columns = np.hstack([of_matrix, of_horizon])
    solution = np.linalg.lstsq(columns, p.ravel(), rcond=1e-9)[0]
    width = u.shape[1]
    matrix = solution[:-width].reshape(3, width + 1)
    horizon = [*solution[-width:], 1.0]
    return Placement(scale, np.vstack([matrix, horizon]))
