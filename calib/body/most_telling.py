"""Most telling poses: where a measurement would reduce what a belief does not know.

Greedy choice by the gain of information, the logarithm of the predicted covariance over the
noise (D-optimal; maximum entropy sampling, Shewry and Wynn 1987).  The residual that the body
leaves over keeps poses apart from each other and from those that were measured.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.rows import thinned
from .belief import Body
from .likeness import lengths_of, matern

_MEASURED = 300  # measured rows that the residual is compared with, evenly spread


def most_telling(body: Body, q: Array, n: int, measured: Array) -> NDArray[np.intp]:
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
    known = x[:, :p] @ body.root * (body.kappa / noise[:, None])  # (k, p, parameters)
    own = np.diag((body.tau[:p] / noise) ** 2)
    lengths, rows = lengths_of(body, q), measured[thinned(len(measured), _MEASURED)]
    alike = matern(rows, rows, lengths) + np.eye(len(rows)) / max(float(own.max()), 1e-12)
    seen = np.linalg.solve(np.linalg.cholesky(alike), matern(rows, q, lengths)).T  # (k, l)
    unexplained = np.maximum(1.0 - (seen**2).sum(axis=1), 0.0)

    def common(best: int) -> Array:
        alike = matern(q, q[best : best + 1], lengths)[:, 0] - seen @ seen[best]
        return np.asarray(alike[:, None, None] * own)

    return greedy(known, n, unexplained[:, None, None] * own, common)


def greedy(
    known: Array, n: int, more: Array | float = 0.0, common: Callable[[int], Array] | None = None
) -> NDArray[np.intp]:
    """Choose rows one by one, each of the largest gain of information beside those before.

    known : (k, p, r), directions in which each row tells of the belief, in units of the noise:
        products of two rows' directions are the covariance of their readings
    n : how many, at most k
    more : (k, p, p), covariance of each row that the belief has no part in
    common : of one row its covariances of that kind with all rows (k, p, p)
    """
    p = known.shape[1]
    spread = known @ np.swapaxes(known, 1, 2) + more
    told = np.zeros((len(known), p, n * p))  # conditioned by a growing Cholesky factor
    chosen = np.empty(n, dtype=np.intp)
    for k in range(n):
        gain = np.linalg.slogdet(np.eye(p) + spread)[1]
        gain[chosen[:k]] = -1.0
        chosen[k] = best = int(gain.argmax())
        between = known @ known[best].T
        if common is not None:
            between = between + common(best)
        between -= told[:, :, : k * p] @ told[best, :, : k * p].T
        root = np.linalg.cholesky(np.eye(p) + spread[best])
        new = np.swapaxes(np.linalg.solve(root, np.swapaxes(between, 1, 2)), 1, 2)
        told[:, :, k * p : (k + 1) * p] = new
        spread -= new @ np.swapaxes(new, 1, 2)
    return chosen
