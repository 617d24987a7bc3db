"""Corners: a camera sees the corners of a board, one of both is in the arm's hand.

The pose of what is in the hand, seen from what stands still, is the reading *pose*; pixels follow
from it.  So a camera in the hand and a board in the hand differ in which is the sensor's frame::

    eye in the hand    pose (R, t) of the camera in the board's frame    s = R' (c - t)
    eye at the base    pose (R, t) of the board in the camera's frame    s = R c + t

with a corner c in the board's frame and s in the camera's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..arm.rotations import cross_matrix, exponential
from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from .sensors import InSpace
from .views import Measurement, Sight, pixels


@dataclass(frozen=True, eq=False)
class Corners(Measurement):
    """Pixels of a board's corners; a row also tells the corner (3,) in the board's frame [m]."""

    pose: InSpace  # of what is in the hand, seen from what stands still; with the camera's lens
    in_hand: bool  # whether the camera is in the hand

    outputs = 2

    def look(
        self, blocks: Mapping[str, Array], motion: Motion, also: Array
    ) -> Sight:
        """See a corner in each row."""
        pose = self.pose.look(blocks, motion, also)
        shift = pose.values[:, :3]
        turn = exponential(pose.values[:, 3:])
        # columns of the derivative of s by the pose's shift and turn, both in the sensor's axes
        if self.in_hand:
            back = np.swapaxes(turn, 1, 2)
            arm = also - shift
            point = np.einsum("nij,nj->ni", back, arm)
            by_turn = back @ cross_matrix(arm)
            by = np.concatenate([-back, by_turn], axis=2)
        else:
            arm = np.einsum("nij,nj->ni", turn, also)
            point = arm + shift
            still = np.broadcast_to(np.eye(3), turn.shape)
            by_turn = -cross_matrix(arm)
            by = np.concatenate([still, by_turn], axis=2)
        camera = pixels(blocks["lens"], point.T)
        by_pose = np.einsum("mkn,nkj->mjn", camera.slope, by)
        slope = np.einsum("mjn,ji->min", by_pose, pose.slope)
        return Sight(camera.values, slope)
