"""Corners: a camera sees the corners of a board, one of both is in the arm's hand.

The pose of what is in the hand, seen from what stands still, is the reading *pose*; pixels follow
from it.  So a camera in the hand and a board in the hand differ in which is the sensor's frame::

    eye in the hand    pose (R, t) of the camera in the board's frame    s = R' (c - t)
    eye at the base    pose (R, t) of the board in the camera's frame    s = R c + t

with a corner c in the board's frame and s in the camera's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arm.rotations import cross_matrix, exponential
from ..common.arrays import Array
from .belief import Body
from .sensor_pose import SensorPose
from .sensors import InSpace
from .settings import FINER
from .spatial import SpatialStructure
from .views import Angular, Measurement, Scene, Sight, pixels


@dataclass(frozen=True, eq=False)
class Corners(Measurement):
    """Pixels of a board's corners; a row also tells the corner (3,) in the board's frame [m]."""

    pose: InSpace  # of what is in the hand, seen from what stands still; with the camera's lens
    in_hand: bool  # whether the camera is in the hand

    outputs = 2
    curves = False  # of 20 pictures they explained a board that had been moved by 5 cm
    within = FINER

    def look(self, scene: Scene) -> _Corner:
        """See a corner in each row."""
        pose = self.pose.look(scene)
        shift = pose.values[:, :3]
        turn = exponential(pose.values[:, 3:])
        # columns of the derivative of s by the pose's shift and turn, both in the sensor's axes
        if self.in_hand:
            back = np.swapaxes(turn, 1, 2)
            arm = scene.also - shift
            point = np.einsum("nij,nj->ni", back, arm)
            by = np.concatenate([-back, back @ cross_matrix(arm)], axis=2)
        else:
            arm = np.einsum("nij,nj->ni", turn, scene.also)
            point = arm + shift
            still = np.broadcast_to(np.eye(3), turn.shape)
            by = np.concatenate([still, -cross_matrix(arm)], axis=2)
        camera = pixels(scene.blocks["lens"], point.T)
        slope = np.asarray(camera.slope).transpose(2, 0, 1)
        by_pose = (slope @ by).transpose(1, 2, 0)
        return _Corner(camera.values, pose, by_pose)


@dataclass(frozen=True)
class _Corner:
    """Pixels of a corner at n rows."""

    values: Array  # (n, 2)
    pose: Sight  # of what is in the hand
    slope: Array  # (2, 6, n), derivative of pixels by the pose

    def push(self, velocity: Array, angular: Angular = 0.0) -> Array:
        """How outputs (..., 2, n) move when the hand does."""
        moved = self.pose.push(velocity, angular)
        return np.asarray((self.slope * moved[..., None, :, :]).sum(axis=-2))


def held_of(body: Body) -> SensorPose:
    """Return what is in the hand, in the tip's frame, as a belief of its poses knows it.

    The last joint counts as its encoder says: what is in the hand turned about that joint's axis,
    and the joint's offset the other way, give the same pictures; so does a shift along it.  What
    is told leaves that out; the other intervals are those of a joint with an offset of its own.
    """
    structure = body.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - poses are in space
    groups = structure.groups
    turns = structure.revolute[-1]
    last = structure.chain_names.index(structure.joint_names[-1])
    base = structure.with_view("base")
    zero = np.zeros((1, structure.dof))
    (tip,), (frame,) = base.pose(zero, structure.neutral())
    axis = structure.chain.axes[last]
    axis_in_tip = frame.T @ axis
    origin = frame.T @ (structure.chain.points[last] - tip)
    shift = structure.shifts[last]
    turn = structure.turns[last]
    offset = groups["offset"][-1]
    tool = groups["tool"]
    tool_turn = groups["tool.rotation"]

    def hand(beta: Array) -> tuple[Array, Array]:
        return beta[tool], exponential(beta[tool_turn])

    def hand_at_encoder(beta: Array) -> tuple[Array, Array]:
        """What a deviation of the last joint of its own does goes to the hand."""
        position, axes = hand(beta)
        turned = axis @ beta[turn] + turns * beta[offset]
        slid = axis @ beta[shift] + (not turns) * beta[offset]
        back = exponential(turned * axis_in_tip)
        moved = origin + back @ (position - origin) + slid * axis_in_tip
        return moved, back @ axes

    index = np.concatenate([tool, tool_turn, shift, turn, [offset]])
    return SensorPose.at(hand, hand_at_encoder, body, index, body.root)
