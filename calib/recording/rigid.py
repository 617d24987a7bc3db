"""Rigid motions as matrices (4, 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rotations import exponential
from ..common.arrays import Array


def rigid(turns: Array, shifts: ArrayLike) -> Array:
    """Rigid motions (..., 4, 4) of rotations (..., 3, 3) and shifts (..., 3)."""
    *axes, _, _ = np.shape(turns)
    poses = np.zeros((*axes, 4, 4))
    poses[..., :3, :3] = turns
    poses[..., :3, 3] = shifts
    poses[..., 3, 3] = 1.0
    return poses


def inverse(pose: Array) -> Array:
    """Inverse of rigid motions (..., 4, 4)."""
    turns = turn_of(pose)
    back = np.swapaxes(turns, -1, -2)
    shifts = back @ pose[..., :3, 3:]
    return rigid(back, -shifts[..., 0])


def turn_of(pose: Array) -> Array:
    """Rotations (..., 3, 3) of rigid motions (..., 4, 4)."""
    return pose[..., :3, :3]


def shift_of(pose: Array) -> Array:
    """Shifts (..., 3) of rigid motions (..., 4, 4)."""
    return pose[..., :3, 3]


def step_from(poses: Array, steps: Array) -> Array:
    """Poses (n, 4, 4) after steps (n, 6): a turn [rad] in own axes, a shift in the parent's."""
    turns = turn_of(poses) @ exponential(steps[:, :3])
    shifts = shift_of(poses) + steps[:, 3:]
    return rigid(turns, shifts)


def place_points(poses: Array, points: Array) -> Array:
    """Points (n, k, 3) of a body (k, 3) at its poses (n, 4, 4)."""
    turns = np.swapaxes(turn_of(poses), 1, 2)
    shifts = shift_of(poses)
    places: Array = points @ turns
    return places + shifts[:, None]
