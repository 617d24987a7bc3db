"""Poses: joint values for many positions, or positions and orientations, of an arm in space.

Use it for tables of poses; `calib.Model.solve` answers positions alone, in the sensor's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arm.rotations import logarithm, matrix_of, quaternion_of
from ..common.arrays import Array
from ..common.rows import checked_rows
from ..errors import QueryError
from ..samples.motion import Motion
from ..samples.roles import QUATERNION, ROUNDING
from .answers import anchor, rows_for
from .parts import Parts
from .prediction import predict
from .space import REACHED, Space


class PoseAnswers(NamedTuple):
    """Answers to poses; without `every` one for each, in their order."""

    target: NDArray[np.intp]  # (k,), which pose each answer belongs to, ascending
    q: Array  # (k, dof) [rad or m], joint values; out of reach those that come nearest
    # (k, 3), (k, 4), where they put the tip, in the frame of the question
    position: Array
    quaternion: Array
    distance: Array  # (k,), from the position wanted [m, or the sensor's unit in its frame]
    turned: Array  # (k,) [rad], from the orientation wanted; 0 where none was
    # (k,), 95 % bounds as of `Answer`; both on the true position in the base frame
    expected_error: Array
    model_error: Array
    reachable: NDArray[np.bool_]  # (k,)


def solve_poses(
    model: Parts,
    position: ArrayLike,
    quaternion: ArrayLike | None = None,
    near: ArrayLike | None = None,
    *,
    frame: str = "sensor",
    every: bool = False,
    keep: bool = False,
    bounded: bool = True,
) -> PoseAnswers:
    """Joint values for positions and, if given, orientations.

    position, quaternion, near, frame : as of :meth:`calib.Model.inverse_pose`
    every : whether all branches of a pose are wanted, the nearest first
    keep : of a position, whether the orientation at `near` is kept as far as the joints allow
    bounded : whether the answers' bounds are found, which takes as long as the answers; else NaN
    Raises QueryError if the model knows no arm in space, a value is no number, or a quaternion is
    none.
    """
    space = Space.of(model)
    if frame != "base" and space.camera:
        raise QueryError("pixels are no positions in space: ask with frame='base'")
    p, _ = checked_rows(position, ("x", "y", "z"), "positions")
    n = len(p)
    r = None if quaternion is None else _rotations(quaternion, n)
    wish = model.motor.scale.from_unit(anchor(model, near, n))
    if frame != "base":
        same = np.tile(np.eye(3), (n, 1, 1)) if r is None else r
        p, turned = space.to_base(p, same)
        r = None if r is None else turned
    if r is None:
        q, target = space.at_positions(p, wish, keep=keep), np.arange(n)
    else:
        found = space.at_poses(p, r, wish, every=every)
        target = np.repeat(np.arange(n), [len(rows) for rows in found])
        q = np.concatenate([wish[:0], *found])
    position, rotation, _ = space.evaluate(q)
    away, turned = np.linalg.norm(position - p[target], axis=1), np.zeros(len(q))
    if r is not None:
        turned = np.linalg.norm(logarithm(r[target] @ np.swapaxes(rotation, 1, 2)), axis=1)
    met = (away <= REACHED * space.length) & (turned <= 10 * REACHED)
    reachable = np.isin(target, target[met])
    bound = error = np.full(len(q), np.nan)
    if frame != "base":
        position, rotation = space.to_sensor(position, rotation)
        away = space.sensor[2] * away
    if bounded and frame == "base":
        bound = error = space.bound(q)
    elif bounded:
        prediction = predict(model, Motion(q))
        bound = prediction.bound
        error = prediction.true_bound
    turns = quaternion_of(rotation)
    return PoseAnswers(target, q, position, turns, away, turned, bound, error, reachable)


def _rotations(quaternion: ArrayLike, n: int) -> Array:
    """Matrices (n, 3, 3) of quaternions (n, 4)."""
    turns = rows_for(quaternion, QUATERNION, "quaternion", n)
    length = np.linalg.norm(turns, axis=1)
    if (np.abs(length - 1.0) > ROUNDING).any():  # files round to a few digits
        row = int(np.argmax(np.abs(length - 1.0)))
        raise QueryError(
            f"the quaternion of row {row + 1} has length {length[row]:.4g}: expected length "
            "1, in the order qx, qy, qz, qw"
        )
    return matrix_of(turns / length[:, None])
