"""Radii that hold 95 % of a Gaussian, and the inflation that leave-block-out errors ask for."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array

NORMAL_95 = 1.6448536269514722  # one-sided quantile of 95 %

_LAGS = 60  # rows that an autocorrelation is followed over


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
