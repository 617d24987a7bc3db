"""Information: which poses would tell most of an arm beside those that were measured.

Poses are chosen by the gain of information, the logarithm of the predicted covariance over the
noise (D-optimal; maximum entropy sampling, Shewry and Wynn 1987).
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Index
from .belief import Body

# length [rad] over which the residual of a log is alike (Matern 5/2)
_SMOOTH = 0.5


def matern(q: Array, other: Array, lengths: Array) -> Array:
    """Matern 5/2 correlation (n, k) of joints (n, dof) and (k, dof)."""
    away = q[:, None] / lengths - other / lengths
    d = np.sqrt(5.0) * np.linalg.norm(away, axis=2)
    rising = 1 + d + d * d / 3
    correlation: Array = rising * np.exp(-d)
    return correlation


def lengths_of(body: Body, q: Array) -> Array:
    """Correlation lengths (dof,) [rad or m] of a log's own residual."""
    turning = np.asarray(body.structure.revolute)
    span = np.maximum(np.ptp(q, axis=0), 1e-9)
    smooth = _SMOOTH * np.sqrt(body.structure.dof / 2)
    lengths: Array = np.where(turning, smooth, 0.3 * span)
    return lengths


def most_telling(body: Body, q: Array, n: int) -> Index:
    """Choose poses one by one, each the most informative beside those chosen before.

    body : its posterior holds the measured rows already
    q : (k, dof) [rad or m], poses to choose from
    n : how many, at most k
    Returns (n,), rows of `q`, in the order of choice.
    """
    structure = body.structure
    p = structure.blocks[0]
    # what no parameter explains counts as noise
    noise = np.hypot(body.noise, body.tau)[:p]
    _, slope = structure.linearise(q, body.beta, body.active)
    directions = slope[:, :p] @ body.root
    directions *= body.kappa
    directions /= noise[:, None]
    return greedy(directions, n)


def greedy(directions: Array, n: int) -> Index:
    """Choose rows one by one, each of the largest gain of information beside those before.

    directions : (k, p, r), in which each row tells of the belief, in units of the noise: products
        of two rows' directions are the covariance of their readings
    n : how many, at most k
    """
    eye = np.eye(directions.shape[1])
    chosen: list[int] = []
    for _ in range(n):
        spread = directions @ np.swapaxes(directions, 1, 2)
        _, gain = np.linalg.slogdet(eye + spread)
        gain[chosen] = -1.0
        best = int(gain.argmax())
        chosen.append(best)
        # ways that the row tells, and the share of the belief's sd that it leaves along them
        ways, sizes, _ = np.linalg.svd(directions[best].T, full_matrices=False)
        shares = 1 / np.sqrt(1 + sizes**2)
        along_ways = directions @ ways
        directions = directions - (1 - shares) * along_ways @ ways.T
    return np.array(chosen, dtype=np.intp)
