"""Rigid motions as matrices (4, 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rotations import exponential
from ..common.arrays import Array


def rigid(turns: Array, shifts: ArrayLike) -> Array:
    """Rigid motions (..., 4, 4) of rotations (..., 3, 3) and shifts (..., 3)."""
    out = np.zeros((*np.shape(turns)[:-2], 4, 4))
    out[..., :3, :3] = turns
    out[..., :3, 3] = shifts
    out[..., 3, 3] = 1.0
    return out


def inverse(pose: Array) -> Array:
    """Inverse of rigid motions (..., 4, 4)."""
    back = np.swapaxes(turn_of(pose), -1, -2)
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
    return rigid(turns, shift_of(poses) + steps[:, 3:])


def place_points(poses: Array, points: Array) -> Array:
    """Points (n, k, 3) of a body (k, 3) at its poses (n, 4, 4)."""
    turns = np.swapaxes(turn_of(poses), 1, 2)
    shifts = shift_of(poses)
    return np.asarray(points @ turns + shifts[:, None])
