"""Near: joint values that reach a position and stay close to given ones, orientation kept softly.

For arms with more joints than a position needs. Among all joints that reach it, the ones are
sought that minimise the distance to `near` and, if asked, the turn away from an orientation.
"""

from __future__ import annotations

import numpy as np

from ..arm.rotations import logarithm
from ..common.arrays import Array
from .pose import Evaluate, Joints, taken

_STEPS = 60
#: A position is reached within this share of the arm's length.
_TOLERANCE = 1e-9


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

    def merit(q: Array, r: Array) -> Array:
        """What is minimised (n,): joint motion and, times `keep`, the turn."""
        turn = logarithm(wanted @ np.swapaxes(r, 1, 2))
        return np.asarray(((q - near) ** 2).sum(axis=1) + keep**2 * (turn**2).sum(axis=1))

    def step(free: Array) -> Array:
        """Step (n, dof) to the minimum of the linearised problem that reaches the position."""
        slope, turning = jacobian[:, :3] * free[:, None, :], jacobian[:, 3:] * free[:, None, :]
        turn = logarithm(wanted @ np.swapaxes(r, 1, 2))
        # minimise |near - q - s|^2 + keep^2 |turn - T s|^2 with J s = position - p
        back = keep**2 * np.swapaxes(turning, 1, 2)
        inverse = np.linalg.inv(np.eye(dof) + back @ turning)
        pull = free * (near - q) + (back @ turn[:, :, None])[:, :, 0]
        reached = slope @ inverse @ np.swapaxes(slope, 1, 2)
        # at a fold no force reaches the position: a little slack keeps the step finite
        reached[:, range(3), range(3)] += 1e-9 * length**2
        lacking = position - p - (slope @ inverse @ pull[:, :, None])[:, :, 0]
        force = np.linalg.solve(reached, lacking[:, :, None])
        total = pull + (np.swapaxes(slope, 1, 2) @ force)[:, :, 0]
        return np.asarray((inverse @ total[:, :, None])[:, :, 0] * free)

    share = np.ones(n)
    p, r, jacobian = evaluate(q)
    distance, cost = np.linalg.norm(position - p, axis=1), merit(q, r)
    for _ in range(_STEPS):
        free = np.ones((n, dof))
        for _ in range(2):  # once as if there were no limits, once with what meets one held
            move = step(free)
            beyond = ((q + move) < joints.lower) | ((q + move) > joints.upper)
            free[beyond & ((q <= joints.lower) | (q >= joints.upper))] = 0.0
        move *= np.minimum(share, 0.5 / np.maximum(np.abs(move).max(axis=1), 1e-300))[:, None]
        trial = np.clip(q + move, joints.lower, joints.upper)
        there = evaluate(trial)
        away, price = np.linalg.norm(position - there[0], axis=1), merit(trial, there[1])
        close = away <= _TOLERANCE * length
        better = (away < distance) | (close & (price <= cost))
        settled = close & (np.abs(trial - q).max(axis=1) < 1e-10)
        new, old = (trial, *there, away, price), (q, p, r, jacobian, distance, cost)
        q, p, r, jacobian, distance, cost = taken(better, new, old)
        share = np.where(better, np.minimum(1.0, 2 * share), share / 3)
        if (settled | (share < 1e-9)).all():
            break
    return q, distance
