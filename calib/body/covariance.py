"""Covariances: their roots, packed for a file, the spread of predictions, and radii that hold 95 %.

A packed covariance is a triangle of single precision: half the size, and positive by construction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array

NORMAL_95 = 1.6448536269514722  # one-sided quantile of 95 %

RADIUS_95 = 2.448
"""Radius that holds 95 % of a Gaussian in the plane of standard deviation 1."""

_LAGS = 60  # rows that an autocorrelation is followed over

Packed = NDArray[np.float32]


def radius_95(covariance: Array) -> Array:
    """Radius (n,) of the ball that holds 95 % of Gaussians of covariance (n, p, p).

    The squared length is taken as a scaled chi-square of the same mean and variance
    (Satterthwaite 1946), its quantile by Wilson and Hilferty (1931).
    """
    trace = np.einsum("nii->n", covariance)
    square = (covariance**2).sum(axis=(1, 2))
    freedom = trace**2 / np.maximum(square, 1e-300)
    a = 2 / (9 * np.maximum(freedom, 1e-300))
    return np.asarray(np.sqrt(np.maximum(trace, 0.0) * (1 - a + NORMAL_95 * np.sqrt(a)) ** 3))


def spread_of(derivative: Array, root: Array) -> Array:
    """Covariances (n, p, p) of predictions: derivatives (n, p, k), root (k, r) of a covariance."""
    n, p, k = derivative.shape
    y = (derivative.reshape(n * p, k) @ root).reshape(n, p, -1)
    return np.asarray(y @ np.swapaxes(y, 1, 2))


def root_of(covariance: Array) -> Array:
    """A root (k, k) of a positive semidefinite matrix, without a jitter."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / scale[:, None] / scale)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) * scale[:, None])


def autocorrelation_time(r: Array) -> float:
    """Integrated autocorrelation time [rows] of residuals (n, m) in the order of the log."""
    n = len(r)
    if n < 40:
        return 1.0
    limit = 4 * np.median(np.abs(r)) + 1e-300
    r = np.clip(r, -limit, limit)
    r = r - r.mean(axis=0)
    power = float((r * r).sum()) + 1e-300
    total = 1.0
    for lag in range(1, min(_LAGS, n // 3)):
        rho = float((r[lag:] * r[:-lag]).sum()) / power
        if rho < 2 / np.sqrt(r.size):
            break
        total += 2 * rho
    return total


def pack(covariance: Array) -> Packed:
    """Upper triangular root (k (k + 1) / 2,) of a covariance, row by row."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(deviations > 0, deviations, 1.0)
    correlation = covariance / safe[:, None] / safe
    try:
        upper = np.linalg.cholesky((correlation + correlation.T) / 2).T
    except np.linalg.LinAlgError:  # semidefinite
        values, vectors = np.linalg.eigh((correlation + correlation.T) / 2)
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        upper = np.asarray(np.linalg.qr(root, mode="r"), dtype=float)
        upper *= np.where(np.diag(upper) < 0, -1.0, 1.0)[:, None]
    upper = upper * deviations
    return upper[np.triu_indices(len(upper))].astype(np.float32)


def unpack(packed: Packed, size: int) -> Array:
    """The covariance (size, size) of a packed root."""
    upper = _triangle(packed, size)
    return np.asarray(upper.T @ upper)


def root_in(covariance: Array, packed: Packed | None) -> Array:
    """A root (k, k) of a covariance: the packed triangle where that is its own."""
    if packed is not None and _is_of(packed, covariance):
        return _triangle(packed, len(covariance)).T  # a fifth of the eigenvectors' time, half zero
    return root_of(covariance)


def packed_of(covariance: Array, packed: Packed | None) -> Packed:
    """The packed root of a covariance: the one at hand where it is the covariance's own."""
    return packed if packed is not None and _is_of(packed, covariance) else pack(covariance)


def _triangle(packed: Packed, size: int) -> Array:
    upper = np.zeros((size, size))
    upper[np.triu_indices(size)] = packed
    return upper


def _is_of(packed: Packed, covariance: Array) -> bool:
    size = len(covariance)
    fits = len(packed) == size * (size + 1) // 2
    return fits and np.array_equal(unpack(packed, size), covariance)
