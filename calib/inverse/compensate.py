"""Compensation in space: joint values that bring the real tool to the nominal pose."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import logarithm
from .pose import Evaluate

Array = NDArray[np.float64]

#: Position (n, 3) [m] and orientation (n, 3, 3) at joints (n, dof).
Pose = Callable[[Array], tuple[Array, Array]]

STEPS, DAMPING = 2, 1e-3
#: Longest step of a joint [rad or m]: arms differ by little, except near singular poses.
LARGEST = 0.2


def compensate(
    nominal: Evaluate,
    real: Pose,
    q: Array,
    length: float,
    *,
    steps: int = STEPS,
    damping: float = DAMPING,
) -> tuple[Array, Array, Array]:
    """Correct commanded joint values, so that the real arm stands where the nominal one would.

    The nominal Jacobian is good enough: the two arms differ by millimetres, and each step leaves a
    share of the difference as small as they differ.

    Parameters
    ----------
    nominal : callable
        Position, orientation and Jacobian (n, 6, dof) of the arm as drawn.
    real : callable
        Pose of the arm as calibrated, in the same frame.
    q : (n, dof) array [rad or m]
        Commanded joint values.
    length : float [m]
        The arm's length: what a radian of orientation is worth.

    Returns
    -------
    corrected : (n, dof) array [rad or m]
    distance : (n,) array [m]
        Of the real tool from its nominal position, by the model, after correction.
    turn : (n,) array [rad]
        Of its orientation.
    """
    position, rotation, jacobian = nominal(q)
    scale = np.r_[np.ones(3), np.full(3, length)][:, None]
    slope = jacobian * scale
    transposed = np.swapaxes(slope, 1, 2)
    square = slope @ transposed
    power = np.einsum("nii->n", square) / 6
    square[:, range(6), range(6)] += (damping**2 * power)[:, None] + 1e-300
    out = np.array(q, dtype=float)

    def lacking(q: Array) -> tuple[Array, Array]:
        p, r = real(q)
        return position - p, logarithm(rotation @ np.swapaxes(r, 1, 2))

    def size(away: Array, turn: Array) -> Array:
        turned = length * np.linalg.norm(turn, axis=1)
        return np.asarray(np.hypot(np.linalg.norm(away, axis=1), turned))

    away, turn = lacking(out)
    for _ in range(steps):
        e = np.concatenate([away, length * turn], axis=1)
        step = (transposed @ np.linalg.solve(square, e[:, :, None]))[:, :, 0]
        step *= np.minimum(1.0, LARGEST / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        trial = lacking(out + step)
        better = (size(*trial) < size(away, turn))[:, None]  # near singular poses it may not be
        out = np.where(better, out + step, out)
        away, turn = np.where(better, trial[0], away), np.where(better, trial[1], turn)
    return out, np.linalg.norm(away, axis=1), np.linalg.norm(turn, axis=1)
