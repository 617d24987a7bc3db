"""Poses: joint values for many positions, or positions and orientations, of an arm in space.

Use it for tables of poses; `calib.Model.solve` answers positions alone, in the sensor's frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rotations import QUATERNION, matrix_of, quaternion_of
from ..common.arrays import Array, Index
from ..common.choices import FRAMES, check_choice
from ..common.inputs import query_rows
from ..common.rows import row_lengths
from ..errors import QueryError
from ..inverse.task import Poses, turn_left
from ..samples.motion import Motion
from ..samples.settings import READING
from .answers import Answer, near_in_box, near_on_turn, rows_for
from .parts import ModelParts
from .prediction import Prediction
from .reach import Reach
from .space import REACHED, Space
from .turns import on_turn


def solve_poses(
    model: ModelParts,
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

    position, quaternion, near, frame : see :meth:`calib.Model.inverse_pose`
    every : whether all branches of a pose are wanted, the nearest first
    keep : of a position, whether the orientation at `near` is kept as far as the joints allow
    free : of a pose, the tip's axis "x", "y" or "z" about which it may turn freely
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
    in_base = frame == "base"
    place, _ = query_rows(position, ("x", "y", "z"), "positions")
    n = len(place)
    rotation = np.tile(np.eye(3), (n, 1, 1))
    if quaternion is not None:
        rotation = _rotations(quaternion, n)
    if not in_base:
        place, rotation = space.to_base(place, rotation)
    posed = quaternion is not None
    goals = Goals(space, place, rotation, posed, free_axis(free))
    near_u = near_in_box(model, near, n)
    in_range = model.motor.scale.from_unit(near_u)
    q, target = goals.joints(in_range, every=every, keep=keep)
    near_q = near_on_turn(model, near_u, near)
    q = on_turn(model, q, near_q[target])
    answer = goals.answer(q, target, in_base=in_base)
    if not bounded:
        return answer
    if in_base:
        reading_bound = position_bound = space.bound(q)
    else:
        prediction = Prediction(model, Motion(q))
        reading_bound = prediction.reading_bound
        position_bound = prediction.position_bound
    return answer._replace(
        expected_error=reading_bound, model_error=position_bound
    )


@dataclass(frozen=True, eq=False)
class Goals:
    """Places or poses of the base frame that joints have to reach."""

    space: Space
    place: Array  # (n, 3) [m]
    rotation: Array  # (n, 3, 3)
    posed: bool  # whether orientations count
    free_axis: int | None  # axis of the tip about which it may turn freely

    def joints(
        self, start: Array, *, every: bool, keep: bool
    ) -> tuple[Array, Index]:
        """Joints (k, dof) near `start` (n, dof), and which goal each is for, (k,)."""
        reach = Reach.of(self.space, posed=self.posed, free_axis=self.free_axis)
        target = np.arange(len(start))
        if not self.posed:
            search = reach.least_turn_joints if keep else reach.nearest
            return search(self.place, start), target
        goal = Poses.target(self.place, self.rotation)
        if not every:
            return reach.nearest(goal, start), target
        solutions = reach.branches(goal, start)
        target = np.repeat(target, [len(rows) for rows in solutions])
        return np.concatenate([start[:0], *solutions]), target

    def answer(self, q: Array, target: Index, *, in_base: bool) -> Answer:
        """Answers of joints (k, dof) to goals (k,), without bounds."""
        space = self.space
        position, rotation, _ = space.evaluate(q)
        distance = row_lengths(position - self.place[target])
        angle = np.zeros(len(q))
        if self.posed:
            rest = turn_left(rotation, self.rotation[target], self.free_axis)
            angle = row_lengths(rest)
        met = distance <= REACHED * space.length
        met &= angle <= 10 * REACHED
        reached = np.isin(target, target[met])
        if not in_base:
            position, rotation = space.to_sensor(position, rotation)
            distance = space.sensor[2] * distance
        unknown = np.full(len(q), np.nan)
        return Answer(
            q,
            position,
            distance,
            expected_error=unknown,
            model_error=unknown,
            reachable=reached,
            target=target,
            quaternion=quaternion_of(rotation),
            turned=angle,
        )


def pose_in_sensor(
    model: ModelParts, position: ArrayLike, quaternion: ArrayLike | None
) -> tuple[Array, Array | None]:
    """Position (3,) and quaternion (4,), if there is one, of the base frame in the sensor's."""
    space = Space.of(model)
    place, _ = query_rows(position, ("x", "y", "z"), "positions")
    if quaternion is None:
        return space.to_sensor(place, np.eye(3))[0][0], None
    rotation = _rotations(quaternion, len(place))
    place, rotation = space.to_sensor(place, rotation)
    return place[0], quaternion_of(rotation)[0]


def free_axis(name: str | None) -> int | None:
    """Index of the tip's axis about which it may turn freely."""
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
    return matrix_of(rows / row_lengths(rows)[:, None])


def wrong_length(quaternion: ArrayLike, n: int = 1) -> str:
    """What is wrong with the first of quaternions (n, 4) that is not of length 1, or ""."""
    rows = rows_for(quaternion, QUATERNION, "quaternion", n)
    length = row_lengths(rows)
    off = np.abs(length - 1.0)
    if not (off > READING.rounded_length).any():
        return ""
    row = int(np.argmax(off))
    return (
        f"the quaternion of row {row + 1} has length {length[row]:.4g}: expected length "
        "1, in the order qx, qy, qz, qw"
    )
