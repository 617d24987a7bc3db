"""Poses: joint values for many positions, or positions and orientations, of an arm in space.

Use it for tables of poses; `calib.Model.solve` answers positions alone, in the sensor's frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rotations import matrix_of, quaternion_of
from ..common.arrays import Array
from ..common.choices import FRAMES, check_choice
from ..common.inputs import query_rows
from ..errors import QueryError
from ..inverse.task import Poses, turn_left
from ..samples.motion import Motion
from ..samples.roles import QUATERNION, ROUNDING
from .answers import Answer, anchor, rows_for, wished_joints
from .parts import Parts
from .prediction import predict
from .reach import Reach
from .space import REACHED, Space
from .turns import on_turn


def solve_poses(
    model: Parts,
    position: ArrayLike,
    quaternion: ArrayLike | None = None,
    near: ArrayLike | None = None,
    *,
    frame: str = "sensor",
    every: bool = False,
    keep: bool = False,
    free: str | None = None,
    bounded: bool = True,
) -> Answer:
    """Joint values for positions and, if given, orientations.

    position, quaternion, near, frame : as of :meth:`calib.Model.inverse_pose`
    every : whether all branches of a pose are wanted, the nearest first
    keep : of a position, whether the orientation at `near` is kept as far as the joints allow
    free : of a pose, the tip's axis "x", "y" or "z" about which its turn is left open
    bounded : whether the answers' bounds are found, which takes as long as the answers; else NaN
    Raises QueryError if the model knows no arm in space, a value is no number, or a quaternion is
    none.
    """
    space = Space.of(model)
    check_choice("frame", frame, FRAMES, QueryError)
    if frame != "base" and space.camera:
        raise QueryError(
            "pixels are no positions in space: ask with frame='base'"
        )
    place, _ = query_rows(position, ("x", "y", "z"), "positions")
    n = len(place)
    rotation = np.tile(np.eye(3), (n, 1, 1))
    if quaternion is not None:
        rotation = _rotations(quaternion, n)
    wish = anchor(model, near, n)
    wished = wished_joints(model, wish, near)
    start = model.motor.scale.from_unit(wish)
    if frame != "base":
        place, rotation = space.to_base(place, rotation)
    axis = free_axis(free)
    posed = quaternion is not None
    reach = Reach.of(space, posed=posed, free=axis)
    goal = Poses.target(place, rotation) if posed else place
    target = np.arange(n)
    if keep and not posed:
        q = reach.least_turn_joints(place, start)
    elif every and posed:
        ways = reach.branches(goal, start)
        target = np.repeat(target, [len(rows) for rows in ways])
        q = np.concatenate([start[:0], *ways])
    else:
        q = reach.nearest(goal, start)
    q = on_turn(model, q, wished[target])
    position, orientation, _ = space.evaluate(q)
    distance = np.linalg.norm(position - place[target], axis=1)
    angle = np.zeros(len(q))
    if posed:
        rest = turn_left(orientation, rotation[target], axis)
        angle = np.linalg.norm(rest, axis=1)
    met = (distance <= REACHED * space.length) & (angle <= 10 * REACHED)
    if frame != "base":
        position, orientation = space.to_sensor(position, orientation)
        distance = space.sensor[2] * distance
    bound = error = np.full(len(q), np.nan)
    if bounded and frame == "base":
        bound = error = space.bound(q)
    elif bounded:
        prediction = predict(model, Motion(q))
        bound = prediction.bound
        error = prediction.true_bound
    return Answer(
        q,
        position,
        distance,
        bound,
        error,
        np.isin(target, target[met]),
        target,
        quaternion_of(orientation),
        angle,
    )


def pose_in_sensor(
    model: Parts, position: ArrayLike, quaternion: ArrayLike | None
) -> tuple[Array, Array | None]:
    """A pose (3,), (4,) of the base frame, or a place, in the sensor's."""
    space = Space.of(model)
    place, _ = query_rows(position, ("x", "y", "z"), "positions")
    if quaternion is None:
        return space.to_sensor(place, np.eye(3))[0][0], None
    rotation = _rotations(quaternion, len(place))
    place, rotation = space.to_sensor(place, rotation)
    return place[0], quaternion_of(rotation)[0]


def free_axis(name: str | None) -> int | None:
    """Index of the tip's axis about which its turn is left open."""
    if name is None:
        return None
    check_choice("free", name, "xyz", QueryError)
    return "xyz".index(name)


def _rotations(quaternion: ArrayLike, n: int) -> Array:
    """Matrices (n, 3, 3) of quaternions (n, 4)."""
    rows = rows_for(quaternion, QUATERNION, "quaternion", n)
    complaint = wrong_length(rows, n)
    if complaint:
        raise QueryError(complaint)
    return matrix_of(rows / np.linalg.norm(rows, axis=1)[:, None])


def wrong_length(quaternion: ArrayLike, n: int = 1) -> str:
    """Say which of some quaternions (n, 4) is none by its length; nothing where all are one."""
    rows = rows_for(quaternion, QUATERNION, "quaternion", n)
    length = np.linalg.norm(rows, axis=1)
    off = np.abs(length - 1.0)
    if not (off > ROUNDING).any():  # files round to a few digits
        return ""
    row = int(np.argmax(off))
    return (
        f"the quaternion of row {row + 1} has length {length[row]:.4g}: expected length "
        "1, in the order qx, qy, qz, qw"
    )
