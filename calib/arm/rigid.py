"""Rigid motions as matrices (4, 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from .rotations import cross_matrix, exponential


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
    back = turns.mT
    shifts = back @ pose[..., :3, 3:]
    return rigid(back, -shifts[..., 0])


def turn_of(pose: Array) -> Array:
    """Rotations (..., 3, 3) of rigid motions (..., 4, 4)."""
    return pose[..., :3, :3]


def shift_of(pose: Array) -> Array:
    """Shifts (..., 3) of rigid motions (..., 4, 4)."""
    return pose[..., :3, 3]


def step_from(poses: Array, steps: Array) -> Array:
    """Poses (n, 4, 4) after steps (n, 6): a turn [rad] and a shift [m] along own axes."""
    stepped: Array = poses @ rigid(exponential(steps[:, :3]), steps[:, 3:])
    return stepped


def adjoint(poses: Array) -> Array:
    """Steps (.., 6, 6) before poses (.., 4, 4) by steps behind: P exp(s) = exp(adjoint(P) s) P."""
    turns = turn_of(poses)
    steps = np.zeros((*turns.shape[:-2], 6, 6))
    steps[..., :3, :3] = turns
    steps[..., 3:, :3] = cross_matrix(shift_of(poses)) @ turns
    steps[..., 3:, 3:] = turns
    return steps


def along_parent(pose: Array) -> Array:
    """Turn and shift (6, 6) along the axes of a pose's parent by steps of the pose (4, 4)."""
    return np.asarray(np.kron(np.eye(2), turn_of(pose)), float)


def shifts_along_parents(poses: Array) -> Array:
    """Slope (6 k, 6 k) of turns as they are, and shifts along the parents', by steps of k poses."""
    slope = np.eye(6 * len(poses))
    for k, turn in enumerate(turn_of(poses)):
        shift = slice(6 * k + 3, 6 * k + 6)
        slope[shift, shift] = turn
    return slope


def place_points(poses: Array, points: Array) -> Array:
    """Points (..., k, 3) of a body (k, 3) at its poses (..., 4, 4)."""
    turns = turn_of(poses).mT
    shifts = shift_of(poses)
    places: Array = points @ turns
    return places + shifts[..., None, :]
