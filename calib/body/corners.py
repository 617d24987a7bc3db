"""Corners: a camera sees the corners of a board, one of both is in the arm's hand.

The pose of what is in the hand, seen from what stands still, is the reading *pose*; pixels follow
from it.  So a camera in the hand and a board in the hand differ in which is the sensor's frame::

    eye in the hand    pose (R, t) of the camera in the board's frame    s = R' (c - t)
    eye at the base    pose (R, t) of the board in the camera's frame    s = R c + t

with a corner c in the board's frame and s in the camera's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..arm.rotations import cross_matrix, exponential, logarithm
from ..common.arrays import Array
from .belief import Body
from .sensor_pose import SensorPose
from .sensors import InSpace
from .settings import FINER
from .spatial import SpatialStructure
from .views import Angular, Columns, Measurement, Picture, Scene, Sight, pixels


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
        return _Corner(camera.values, pose, camera, by_pose)


@dataclass(frozen=True)
class _Corner:
    """Pixels of a corner at n rows."""

    values: Array  # (n, 2)
    pose: Sight  # of what is in the hand
    camera: Picture
    slope: Array  # (2, 6, n), derivative of pixels by the pose

    def push(self, velocity: Array, angular: Angular = 0.0) -> Array:
        """How outputs (..., 2, n) move when the hand does."""
        return self._pixels(self.pose.push(velocity, angular))

    def columns(self) -> Columns:
        """The derivative by each of the sensor's own blocks."""
        for name, moved in self.pose.columns():
            yield name, partial(self._by, moved)
        yield "lens", self.camera.refocused

    def _by(self, moved: Callable[[], Array]) -> Array:
        return self._pixels(moved())

    def _pixels(self, moved: Array) -> Array:
        """How pixels move with the pose."""
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

    def places(beta: Array) -> tuple[Array, Array]:
        """Position and turn, and those of a last joint whose own deviation goes to the hand."""
        position = beta[tool]
        hand = exponential(beta[tool_turn])
        turned = axis @ beta[turn] + turns * beta[offset]
        slid = axis @ beta[shift] + (not turns) * beta[offset]
        back = exponential(turned * axis_in_tip)
        moved = origin + back @ (position - origin) + slid * axis_in_tip
        return np.stack([position, moved]), np.stack([hand, back @ hand])

    points, hands = places(body.beta)
    blocks = [tool, tool_turn, shift, turn, [offset]]
    free = np.intersect1d(np.concatenate(blocks), body.active)
    slopes = []
    for index in free:
        step = np.zeros(structure.size)
        step[index] = 1e-6
        ahead, turned = places(structure.retract(body.beta, step))
        by_turn = logarithm(turned @ np.swapaxes(hands, 1, 2))
        slopes.append(np.concatenate([ahead - points, by_turn], axis=1) / 1e-6)
    root = body.root[np.searchsorted(body.active, free)]
    sd = np.sqrt(
        (np.einsum("kpi,kr->pir", np.array(slopes), root) ** 2).sum(axis=2)
    )
    return SensorPose(
        position=points[1],
        rotation=hands[1],
        position_sd=sd[0, :3],
        turn_sd=sd[0, 3:],
        told_sd=sd[1, :3],
        told_turn_sd=sd[1, 3:],
        depth_sd=float(sd[1, 2]),
        first=None,
    )
