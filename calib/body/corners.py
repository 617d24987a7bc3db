"""Corners: a camera sees the corners of a board, one of both is in the arm's hand.

The pose of what is in the hand, seen from what stands still, is the reading *pose*; pixels follow
from it.  So a camera in the hand and a board in the hand differ in which is the sensor's frame::

    eye in the hand    pose (R, t) of the camera in the board's frame    s = R' (c - t)
    eye at the base    pose (R, t) of the board in the camera's frame    s = R c + t

with a corner c in the board's frame and s in the camera's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.rotations import cross_matrix, exponential, logarithm
from ..common.arrays import Array
from .belief import Body
from .sensor import SensorPose
from .sensors import InSpace
from .settings import FINER
from .views import Columns, Measurement, Scene, pixels


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
        seen = self.pose.look(scene)
        shift = seen.values[:, :3]
        turn = exponential(seen.values[:, 3:])
        # columns of the derivative of s by the pose's shift and turn, both in the sensor's axes
        if self.in_hand:
            back = np.swapaxes(turn, 1, 2)
            arm = scene.also - shift
            point = np.einsum("nij,nj->ni", back, arm)
            by = np.concatenate([-back, back @ cross_matrix(arm)], axis=2)
        else:
            arm = np.einsum("nij,nj->ni", turn, scene.also)
            point = arm + shift
            by = np.concatenate(
                [np.broadcast_to(np.eye(3), turn.shape), -cross_matrix(arm)], axis=2
            )
        camera = pixels(scene.blocks["lens"], point.T)
        slope = np.asarray(camera.slope).transpose(2, 0, 1)
        return _Corner(camera.values, seen, camera, (slope @ by).transpose(1, 2, 0))


@dataclass(frozen=True)
class _Corner:
    """Pixels of a corner at n rows."""

    values: Array  # (n, 2)
    pose: Any  # what is in the hand, as a pose
    camera: Any  # the pinhole's view
    slope: Array  # (2, 6, n), derivative of pixels by the pose

    def push(self, velocity: Array, angular: Any = 0.0) -> Array:
        """How outputs (..., 2, n) move when the hand does."""
        return self._seen(self.pose.push(velocity, angular))

    def columns(self) -> Columns:
        """The derivative by each of the sensor's own blocks."""
        for name, own in self.pose.columns():
            yield name, lambda own=own: self._seen(own())  # type: ignore[misc]
        yield "lens", self.camera.refocused

    def _seen(self, moved: Array) -> Array:
        return np.asarray((self.slope * moved[..., None, :, :]).sum(axis=-2))


def held_of(body: Body) -> SensorPose:
    """What is in the hand, in the tip's frame, as a belief of its poses knows it.

    The last joint counts as its encoder says: what is in the hand turned about that joint's axis,
    and the joint's offset the other way, give the same pictures; so does a shift along it.  What
    is told leaves that out; the other intervals are those of a joint with an offset of its own.
    """
    structure: Any = body.structure
    groups = structure.groups
    revolute = structure.revolute[-1]
    last = structure.chain_names.index(structure.joint_names[-1])
    (at,), (frame,) = structure.with_view("base").pose(
        np.zeros((1, structure.dof)), structure.neutral()
    )
    own = structure.chain.axes[last]
    shift = structure.shifts[last]
    turn = structure.turns[last]
    axis = frame.T @ own
    origin = frame.T @ (structure.chain.points[last] - at)

    def places(beta: Array) -> tuple[Array, Array]:
        """Position and turn, and those of a last joint whose own deviation goes to the hand."""
        position = beta[groups["tool"]]
        hand = exponential(beta[groups["tool.rotation"]])
        slid = own @ beta[shift]
        turned = own @ beta[turn]
        offset = beta[groups["offset"][-1]]
        back = exponential((turned + revolute * offset) * axis)
        moved = (
            origin
            + back @ (position - origin)
            + (slid + (not revolute) * offset) * axis
        )
        return np.stack([position, moved]), np.stack([hand, back @ hand])

    points, hands = places(body.beta)
    free = np.concatenate(
        [groups["tool"], groups["tool.rotation"], shift, turn, groups["offset"][-1:]]
    )
    free = np.intersect1d(free, body.active)
    slopes = []
    for index in free:
        ahead, turned = places(
            structure.retract(body.beta, 1e-6 * np.eye(structure.size)[index])
        )
        by_turn = logarithm(turned @ np.swapaxes(hands, 1, 2))
        slopes.append(np.concatenate([ahead - points, by_turn], axis=1) / 1e-6)
    root = body.root[np.searchsorted(body.active, free)]
    sd = np.sqrt((np.einsum("kpi,kr->pir", np.array(slopes), root) ** 2).sum(axis=2))
    (any_sd, any_turn), (told, told_turn) = sd.reshape(2, 2, 3)
    return SensorPose(
        points[1], hands[1], any_sd, any_turn, told, told_turn, told[2], None
    )
