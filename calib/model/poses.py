"""Poses: joint values for many positions, or positions and orientations, of an arm in space.

Use it for tables of poses; `calib.Model.solve` answers positions alone, in the sensor's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arm.rotations import matrix_of, quaternion_of
from ..common.arrays import Array
from ..common.choices import FRAMES, check_choice
from ..common.inputs import query_rows
from ..errors import QueryError
from ..inverse.task import Poses, turn_left
from ..samples.motion import Motion
from ..samples.roles import QUATERNION, ROUNDING
from .answers import anchor, rows_for
from .compilable import prepare
from .parts import Parts
from .prediction import predict
from .reach import Reach
from .space import REACHED, Space
from .turns import nearest_turn, on_turn


class PoseAnswers(NamedTuple):
    """Answers to poses; without `every` one for each, in their order."""

    target: NDArray[
        np.intp
    ]  # (k,), which pose each answer belongs to, ascending
    q: Array  # (k, dof) [rad or m], joint values; out of reach those that come nearest
    # (k, 3), (k, 4), where they put the tip, in the frame of the question
    position: Array
    quaternion: Array
    # (k,), from the position wanted [m, or the sensor's unit in its frame]
    distance: Array
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
    free: str | None = None,
    bounded: bool = True,
) -> PoseAnswers:
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
    p, _ = query_rows(position, ("x", "y", "z"), "positions")
    n = len(p)
    r = None if quaternion is None else _rotations(quaternion, n)
    wish = model.motor.scale.from_unit(anchor(model, near, n))
    wanted_joints = wish
    if near is not None:
        rows = rows_for(near, model.about.joint_names, "near", n)
        wanted_joints = nearest_turn(model, wish, rows)
    axis = free_axis(free)
    if frame != "base":
        same = np.tile(np.eye(3), (n, 1, 1)) if r is None else r
        p, turned = space.to_base(p, same)
        r = None if r is None else turned
    reach = Reach.of(space, posed=r is not None, free=axis)
    target = np.arange(n)
    if r is None and keep:
        q = reach.least_turn_joints(p, wish)
    elif r is None:
        q = reach.nearest(p, wish)
    elif every:
        prepare(model, "branches", n)
        ways = reach.branches(Poses.target(p, r), wish)
        target = np.repeat(target, [len(rows) for rows in ways])
        q = np.concatenate([wish[:0], *ways])
    else:
        prepare(model, "poses", n)
        q = reach.nearest(Poses.target(p, r), wish)
    q = on_turn(model, q, wanted_joints[target])
    position, rotation, _ = space.evaluate(q)
    away = np.linalg.norm(position - p[target], axis=1)
    turned = np.zeros(len(q))
    if r is not None:
        turned = np.linalg.norm(turn_left(rotation, r[target], axis), axis=1)
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
    return PoseAnswers(
        target, q, position, turns, away, turned, bound, error, reachable
    )


def pose_in_sensor(
    model: Parts, position: ArrayLike, quaternion: ArrayLike | None
) -> tuple[Array, Array | None]:
    """A pose (3,), (4,) of the base frame, or a place, in the sensor's."""
    space = Space.of(model)
    place, _ = query_rows(position, ("x", "y", "z"), "positions")
    if quaternion is None:
        return space.to_sensor(place, np.eye(3))[0][0], None
    turn = _rotations(quaternion, len(place))
    place, turn = space.to_sensor(place, turn)
    return place[0], quaternion_of(turn)[0]


def free_axis(name: str | None) -> int | None:
    """Index of the tip's axis about which its turn is left open."""
    if name is None:
        return None
    check_choice("free", name, "xyz", QueryError)
    return "xyz".index(name)


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
