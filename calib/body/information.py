"""Information: which poses would tell most of an arm beside those that were measured.

Poses are chosen by the gain of information, the logarithm of the predicted covariance over the
noise (D-optimal; maximum entropy sampling, Shewry and Wynn 1987).  The residual that the body
leaves over keeps them apart from each other and from those that were measured.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.rows import thinned
from .belief import Body

# length [rad] over which the residual of a log is alike (Matern 5/2)
_SMOOTH = 0.5
# measured rows that the residual is compared with, evenly spread
_MEASURED = 300


def matern(q: Array, other: Array, lengths: Array) -> Array:
    """Matern 5/2 correlation (n, k) of joints (n, dof) and (k, dof)."""
    a = q / lengths
    b = other / lengths
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    d = np.sqrt(5.0 * np.maximum(square, 0.0))
    return np.asarray((1 + d + d * d / 3) * np.exp(-d))


def lengths_of(body: Body, q: Array) -> Array:
    """Correlation lengths (dof,) [rad or m] of a log's own residual."""
    turning = np.asarray(body.structure.revolute)
    span = np.maximum(np.ptp(q, axis=0), 1e-9)
    smooth = _SMOOTH * np.sqrt(body.structure.dof / 2)
    return np.asarray(np.where(turning, smooth, 0.3 * span))


def most_telling(
    body: Body, q: Array, n: int, measured: Array
) -> NDArray[np.intp]:
    """Choose poses one by one, each the most informative beside those chosen before.

    body : its posterior holds the measured rows already
    q : (k, dof) [rad or m], poses to choose from
    n : how many, at most k
    measured : (l, dof) [rad or m], joints of rows that were measured
    Returns (n,), rows of `q`, in the order of choice.
    """
    p = body.structure.blocks[0]
    noise = body.noise[:p]
    _, x = body.structure.linearise(q, body.beta, body.active)
    # (k, p, parameters)
    directions = x[:, :p] @ body.root * (body.kappa / noise[:, None])
    variance = np.diag((body.tau[:p] / noise) ** 2)
    lengths = lengths_of(body, q)
    rows = measured[thinned(len(measured), _MEASURED)]
    nugget = np.eye(len(rows)) / max(float(variance.max()), 1e-12)
    root = np.linalg.cholesky(matern(rows, rows, lengths) + nugget)
    explained = np.linalg.solve(root, matern(rows, q, lengths)).T  # (k, l)
    unexplained = np.maximum(1.0 - (explained**2).sum(axis=1), 0.0)

    def common(best: int) -> Array:
        alike = matern(q, q[best : best + 1], lengths)[:, 0]
        alike = alike - explained @ explained[best]
        return np.asarray(alike[:, None, None] * variance)

    return greedy(directions, n, unexplained[:, None, None] * variance, common)


def greedy(
    directions: Array,
    n: int,
    more: Array | float = 0.0,
    common: Callable[[int], Array] | None = None,
) -> NDArray[np.intp]:
    """Choose rows one by one, each of the largest gain of information beside those before.

    directions : (k, p, r), in which each row tells of the belief, in units of the noise: products
        of two rows' directions are the covariance of their readings
    n : how many, at most k
    more : (k, p, p), covariance of each row that the belief has no part in
    common : of one row its covariances of that kind with all rows (k, p, p)
    """
    p = directions.shape[1]
    spread = directions @ np.swapaxes(directions, 1, 2) + more
    factor = np.zeros((len(directions), p, n * p))  # a growing Cholesky factor
    chosen = np.empty(n, dtype=np.intp)
    for k in range(n):
        gain = np.linalg.slogdet(np.eye(p) + spread)[1]
        gain[chosen[:k]] = -1.0
        best = int(gain.argmax())
        chosen[k] = best
        between = directions @ directions[best].T
        if common is not None:
            between = between + common(best)
        between -= factor[:, :, : k * p] @ factor[best, :, : k * p].T
        root = np.linalg.cholesky(np.eye(p) + spread[best])
        new = np.swapaxes(
            np.linalg.solve(root, np.swapaxes(between, 1, 2)), 1, 2
        )
        factor[:, :, k * p : (k + 1) * p] = new
        spread -= new @ np.swapaxes(new, 1, 2)
    return chosen
