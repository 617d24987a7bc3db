"""What a log shows beyond every member: a smooth residual that fades to zero away from its rows.

A Gaussian process over the joints.  It is kept only where contiguous blocks of rows that it has
not seen are predicted better with it than without.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.likeness import matern
from ..common.arrays import Array
from ..common.rows import thinned
from .rows import RESIDUAL_ROWS

_PARTITIONS = (2, 5, 10)  # contiguous blocks: half of the log must tell of the other half
_LENGTHS = (0.5, 1.0, 2.0)  # times the given lengths
_RATIOS = np.geomspace(1e-8, 10.0, 19)  # variance of the noise over that of the process
_CLEAR = 2.0  # paired standard errors by which blocks must be predicted better
_GAIN = 0.9  # share of the error that must not be left


@dataclass(frozen=True)
class OwnResidual:
    """A Gaussian process that was fitted to residuals."""

    q: Array  # (n, dof), rows [rad or m]
    lengths: Array  # (dof,), correlation lengths [rad or m]
    weights: Array  # (n, m), of the rows' kernels [unit]
    inverse: Array  # (n, n), inverse of the rows' covariance, in units of the process's variance
    sd: float  # [unit], standard deviation of the process away from rows
    held_out: Array  # (n,) [unit], distances of the rows from what is predicted without their block
    rows: NDArray[np.intp]  # (n,), rows of the log that it rests on

    def value(self, q: Array) -> Array:
        """Mean (k, m) at joints (k, dof) [unit]."""
        return np.asarray(matern(q, self.q, self.lengths) @ self.weights)

    def deviation(self, q: Array) -> Array:
        """Standard deviation per axis (k,) at joints (k, dof) [unit]."""
        alike = matern(q, self.q, self.lengths)
        known = np.einsum("ki,ij,kj->k", alike, self.inverse, alike)
        return np.asarray(self.sd * np.sqrt(np.maximum(1.0 - known, 0.0)))


def own_residual(
    q: Array, residual: Array, held: Array, weight: Array, lengths: Array
) -> OwnResidual | None:
    """Fit the process; None where held-out blocks do not ask for it.

    q : (n, dof), rows in the order in which they were measured [rad or m]
    residual, held : (n, m) [unit], measured less predicted, by a fit to all rows and to the other
        blocks
    weight : (n,), weights of the rows
    lengths : (dof,), usual correlation lengths [rad or m]
    """
    rows = thinned(len(q), RESIDUAL_ROWS)
    q, residual, held, weight = q[rows], residual[rows], held[rows], weight[rows]
    n = len(q)
    if n < 2 * _PARTITIONS[-1] or not np.any(residual):
        return None
    tried: list[tuple[float, float, float, float]] = []
    root, m = np.sqrt(weight)[:, None], residual.shape[1]
    for share in _LENGTHS:
        alike = matern(q, q, share * lengths)
        values, vectors = np.linalg.eigh(alike * root * root.T)
        y2 = ((vectors.T @ (residual * root)) ** 2).sum(axis=1)
        for ratio in _RATIOS:
            total = np.maximum(values, 0.0) + ratio
            # the variance of the greatest likelihood is known in closed form
            variance = float((y2 / total).sum()) / (m * n)
            cost = m * (float(np.log(total).sum()) + n * np.log(variance + 1e-300))
            tried.append((cost, share, float(ratio), variance))
    _, share, ratio, variance = min(tried, key=lambda each: each[0])
    lengths = share * lengths
    noise = np.diag(ratio / weight + 1e-10)
    alike = matern(q, q, lengths)
    before = np.linalg.norm(held, axis=1)
    left = np.empty(n)
    for count in _PARTITIONS:
        parts = np.array_split(np.arange(n), count)
        for block in parts:
            others = np.setdiff1d(np.arange(n), block)
            inner = alike[np.ix_(others, others)] + noise[np.ix_(others, others)]
            guess = alike[np.ix_(block, others)] @ np.linalg.solve(inner, residual[others])
            left[block] = np.linalg.norm(held[block] - guess, axis=1)
        if left.mean() > _GAIN * before.mean():
            return None
    gain = np.array([float(np.mean(before[b] - left[b])) for b in parts])
    error = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    if gain.mean() <= _CLEAR * error:
        return None
    inverse = np.linalg.inv(alike + noise)
    sd = float(np.sqrt(variance))
    weights = np.asarray(inverse @ residual)
    return OwnResidual(q, lengths, weights, np.asarray(inverse), sd, left, rows)
