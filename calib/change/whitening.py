"""Whitening: what a belief does not know of a log, as a covariance of its residuals.

The covariance of the rows' residuals holds the old posterior, a creep of all parameters, and
a residual of this log alone: a Gaussian process over the joints whose size is that of the
body's own held-out errors.  Its eigenvectors are found once; then the evidence of every member
costs a few small products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body
from ..body.likeness import kernel, lengths_of
from ..common.arrays import Array

_LEAST = 1e-4  # residual of a log that is always allowed, of the extents
_FLOOR = 1e-6  # least noise, of the extents
_PSEUDO = 4.0  # observations that the old noise counts for
_GRID = 60


@dataclass(frozen=True)
class Scaled:
    """Units in which residuals are compared."""

    size: Array  # (m,) [unit], what each output is divided by: the noise that the belief expects
    floor: float  # least noise, in those sizes


def scaled(body: Body) -> Scaled:
    """Sizes of the outputs for a belief."""
    extents = np.asarray(body.structure.extents, dtype=float)
    size = np.maximum(body.noise, _LEAST * extents)
    return Scaled(size, float(np.min(_FLOOR * extents / size)))


def nuisance_sd(body: Body) -> Array:
    """Standard deviation (m,) [unit] of the residual that a log may have of its own."""
    return np.asarray(np.maximum(body.tau, _LEAST * np.asarray(body.structure.extents)))


@dataclass(frozen=True)
class Spectrum:
    """Covariance of the residuals of some rows, without the noise."""

    values: Array  # (N,), eigenvalues, in squared sizes
    vectors: Array  # (N, N)
    root: Array  # (n,), square roots of the rows' weights
    size: Array  # (m,) [unit], sizes of the outputs

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

    def noise(self, turned: Array, floor: float) -> float:
        """Noise of the greatest likelihood, in sizes; the old noise counts for two rows."""
        high = 2.0 * max(float(np.sqrt(np.mean(turned**2))), 1.0)
        grid = np.geomspace(max(floor, 1e-2), high, _GRID)
        total = self.values[:, None] + grid**2
        cost = np.log(total).sum(axis=0) + (turned[:, None] ** 2 / total).sum(axis=0)
        cost += _PSEUDO * (np.log(grid**2) + 1.0 / grid**2)
        return float(grid[int(np.argmin(cost))])


def spectrum(
    body: Body,
    beta: Array,
    q: Array,
    weight: Array,
    creep: Array,
    factor: float,
    forget: NDArray[np.intp],
    shared: float = 0.0,
) -> Spectrum:
    """Covariance of the rows' residuals under a belief.

    body : the old belief
    beta : (d,), where it is linearised: the old parameters, in the frame of the log
    q : (n, dof)
    weight : (n,)
    creep : (d,), standard deviation by which parameters may have crept
    factor : times the usual size of the log's own residual
    forget : (g,), parameters whose old posterior does not count: a frame that is new
    shared : [unit], standard deviation of an error that neighbouring positions share: that of a
        reference, such as a board, that was found again
    """
    size = scaled(body).size
    active = np.union1d(body.active, np.flatnonzero(creep))
    seen, x = body.structure.linearise(q, beta, active)
    n, m, k = x.shape
    root = np.sqrt(weight)
    flat = (x / size[:, None] * root[:, None, None]).reshape(n * m, k)
    # y = X (b - b0) + own residual + noise: the covariance of the first two, X P X' + K
    known = np.diag(creep[active] ** 2)
    place = np.searchsorted(active, body.active)
    known[np.ix_(place, place)] += body.covariance * body.kappa**2
    kept = ~np.isin(active, forget)
    flat = flat[:, kept]
    total = flat @ known[np.ix_(kept, kept)] @ flat.T
    lengths = lengths_of(body, q)
    alike = kernel(q, q, lengths) * root[:, None] * root
    own = (factor * nuisance_sd(body) / size) ** 2
    total += np.kron(alike, np.diag(own))
    if shared:  # a frame that is shifted, turned, tilted: as smooth as the workspace is wide
        places = seen[:, :m] / (2.0 * np.asarray(body.structure.extents))
        alike = kernel(places, places, np.ones(m)) * root[:, None] * root
        total += np.kron(alike, np.diag((shared / size) ** 2))
    values, vectors = np.linalg.eigh(total)
    return Spectrum(np.maximum(values, 0.0), vectors, root, size)
