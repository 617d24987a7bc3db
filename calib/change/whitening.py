"""Whitening: what a belief does not know of a log, as a covariance of its residuals.

The covariance of the rows' residuals holds the old posterior, a creep of all parameters, and
a residual of this log alone: a Gaussian process over the joints whose size is that of the
body's own held-out errors.  Its eigenvectors are found once; then the evidence of every member
costs a few small products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.likeness import kernel, lengths_of
from ..common.arrays import Array
from .reference import Reference
from .rows import Log

_FLOOR = 1e-6  # least noise, of the extents
_PSEUDO = 4.0  # observations that the old noise counts for
_GRID = 60


@dataclass(frozen=True)
class Spectrum:
    """Covariance of the residuals of some rows, without the noise."""

    values: Array  # (N,), eigenvalues, in squared sizes
    vectors: Array  # (N, N)
    root: Array  # (n,), square roots of the rows' weights
    size: Array  # (m,) [unit], sizes of the outputs
    floor: float  # least noise, in those sizes

    def turn(self, residual: Array) -> Array:
        """Residuals (n, m) in the eigenvectors, (N,)."""
        return np.asarray((residual / self.size * self.root[:, None]).ravel() @ self.vectors)

    def turn_columns(self, derivative: Array) -> Array:
        """Derivatives (n, m, k) in the eigenvectors, (N, k)."""
        flat = derivative / self.size[:, None] * self.root[:, None, None]
        flat = flat.reshape(len(self.vectors), derivative.shape[2])
        return np.asarray(self.vectors.T @ flat)

    def rest(self, turned: Array, noise: float) -> Array:
        """What the process does not follow of residuals (N,) in the eigenvectors, (n, m)."""
        flat = self.vectors @ (turned * noise**2 / (self.values + noise**2))
        return np.asarray(flat.reshape(len(self.root), -1))

    def noise(self, turned: Array) -> float:
        """Noise of the greatest likelihood, in sizes; the old noise counts for two rows."""
        high = 2.0 * max(float(np.sqrt(np.mean(turned**2))), 1.0)
        grid = np.geomspace(max(self.floor, 1e-2), high, _GRID)
        total = self.values[:, None] + grid**2
        cost = np.log(total).sum(axis=0) + (turned[:, None] ** 2 / total).sum(axis=0)
        cost += _PSEUDO * (np.log(grid**2) + 1.0 / grid**2)
        return float(grid[int(np.argmin(cost))])


def spectrum(reference: Reference, log: Log, creep: Array, factor: float) -> Spectrum:
    """Covariance of the rows' residuals under a belief.

    reference : the old belief in the frame of the log, where it is linearised
    log : the rows
    creep : (d,), standard deviation by which parameters may have crept
    factor : times the usual size of the log's own residual
    """
    body, size, root = reference.body, reference.sizes, np.sqrt(log.weight)
    active = np.union1d(body.active, np.flatnonzero(creep))
    seen, x = body.structure.linearise(log.q, reference.beta, active)
    n, m, k = x.shape
    flat = (x / size[:, None] * root[:, None, None]).reshape(n * m, k)
    # y = X (b - b0) + own residual + noise: the covariance of the first two, X P X' + K
    known = np.diag(creep[active] ** 2)
    place = np.searchsorted(active, body.active)
    known[np.ix_(place, place)] += body.covariance * body.kappa**2
    kept = ~np.isin(active, reference.forgotten)
    flat = flat[:, kept]
    total = flat @ known[np.ix_(kept, kept)] @ flat.T
    alike = kernel(log.q, log.q, lengths_of(body, log.q)) * root[:, None] * root
    own = (factor * reference.own_sd / size) ** 2
    total += np.kron(alike, np.diag(own))
    extents = np.asarray(body.structure.extents, dtype=float)
    if log.shared:  # a frame that is shifted, turned, tilted: as smooth as the workspace is wide
        places = seen[:, :m] / (2.0 * extents)
        alike = kernel(places, places, np.ones(m)) * root[:, None] * root
        total += np.kron(alike, np.diag((log.shared / size) ** 2))
    values, vectors = np.linalg.eigh(total)
    floor = float(np.min(_FLOOR * extents / size))
    return Spectrum(np.maximum(values, 0.0), vectors, root, size, floor)
