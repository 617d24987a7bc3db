"""Near: joint values that reach a position and stay close to given ones, orientation kept softly.

For arms with more joints than a position needs. Among all joints that reach it, the ones are
sought that minimise the distance to `near` and, if asked, the turn away from an orientation.
"""

from __future__ import annotations

import numpy as np

from ..arm.rotations import logarithm
from ..common.arrays import Array
from .pose import Evaluate, Joints

STEPS = 60
#: A position is reached within this share of the arm's length.
TOLERANCE = 1e-9


def position_near(
    evaluate: Evaluate,
    position: Array,
    near: Array,
    joints: Joints,
    length: float,
    *,
    keep: float = 0.0,
) -> tuple[Array, Array]:
    """Joints (n, dof) nearest to `near` that reach positions (n, 3), and distances (n,) left.

    The search starts at `near`. A radian of turn away from the orientation there counts `keep`
    times a radian of joint motion: 0 leaves it free, 10 keeps it where that is possible. Each step
    solves the linearised problem with its Lagrange multipliers, and is shortened until the position
    comes nearer; joints that meet a limit stay there for that step. Lengths are in m.
    """
    q = np.clip(near, joints.lower, joints.upper)
    wanted = evaluate(q)[1]
    n, dof = q.shape
    share = np.ones(n)
    p, r, jacobian = evaluate(q)
    distance = np.linalg.norm(position - p, axis=1)
    merit = _merit(q, near, r, wanted, keep)
    for _ in range(STEPS):
        free = np.ones((n, dof), dtype=bool)
        for _ in range(2):  # once as if there were no limits, once with what meets one held
            step = _step(q, near, p, r, jacobian, position, wanted, keep, free, length)
            beyond = ((q + step) < joints.lower) | ((q + step) > joints.upper)
            free &= ~(beyond & ((q <= joints.lower) | (q >= joints.upper)))
        step *= np.minimum(share, 0.5 / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        trial = np.clip(q + step, joints.lower, joints.upper)
        moved = evaluate(trial)
        away = np.linalg.norm(position - moved[0], axis=1)
        cost = _merit(trial, near, moved[1], wanted, keep)
        close = away <= TOLERANCE * length
        better = (away < distance) | (close & (cost <= merit))
        settled = close & (np.abs(trial - q).max(axis=1) < 1e-10)
        q = np.where(better[:, None], trial, q)
        p = np.where(better[:, None], moved[0], p)
        r = np.where(better[:, None, None], moved[1], r)
        jacobian = np.where(better[:, None, None], moved[2], jacobian)
        distance, merit = np.where(better, away, distance), np.where(better, cost, merit)
        share = np.where(better, np.minimum(1.0, 2 * share), share / 3)
        if (settled | (share < 1e-9)).all():
            break
    return q, distance


def _merit(q: Array, near: Array, r: Array, wanted: Array, keep: float) -> Array:
    """What is minimised (n,): joint motion and, times `keep`, the turn."""
    turn = logarithm(wanted @ np.swapaxes(r, 1, 2))
    return np.asarray(((q - near) ** 2).sum(axis=1) + keep**2 * (turn**2).sum(axis=1))


def _step(
    q: Array,
    near: Array,
    p: Array,
    r: Array,
    jacobian: Array,
    position: Array,
    wanted: Array,
    keep: float,
    free: Array,
    length: float,
) -> Array:
    """Step (n, dof) to the minimum of the linearised problem that reaches the position."""
    dof = q.shape[1]
    loose = free.astype(float)
    slope = jacobian[:, :3] * loose[:, None, :]
    turning = jacobian[:, 3:] * loose[:, None, :]
    turn = logarithm(wanted @ np.swapaxes(r, 1, 2))
    # minimise |near - q - s|^2 + keep^2 |turn - T s|^2 with J s = position - p
    hessian = np.eye(dof) + keep**2 * np.swapaxes(turning, 1, 2) @ turning
    pull = loose * (near - q) + keep**2 * (np.swapaxes(turning, 1, 2) @ turn[:, :, None])[:, :, 0]
    inverse = np.linalg.inv(hessian)
    reached = slope @ inverse @ np.swapaxes(slope, 1, 2)
    reached[:, range(3), range(3)] += 1e-9 * length**2
    lacking = position - p - (slope @ inverse @ pull[:, :, None])[:, :, 0]
    force = np.linalg.solve(reached, lacking[:, :, None])
    total = pull + (np.swapaxes(slope, 1, 2) @ force)[:, :, 0]
    return np.asarray((inverse @ total[:, :, None])[:, :, 0] * loose)
