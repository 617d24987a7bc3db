"""Covariances: their factors and roots, packed for a file, spreads, and radii that hold 95 %.

A packed root is a triangle of single precision: half the size, and its square is positive.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .settings import FIT

NORMAL_95 = 1.6448536269514722  # one-sided quantile of 95 %
Z95 = 1.96  # half of a 95 % interval, in standard deviations

RADIUS_95 = 2.448
"""Radius that holds 95 % of a Gaussian in the plane of standard deviation 1."""

_JITTERS = (0.0, 1e-13, 1e-11, 1e-9, 1e-6)
_Packed = NDArray[np.float32]


class Factor:
    """Cholesky factor of a symmetric positive matrix after scaling its diagonal to one.

    matrix : (k, k), flat and tight priors differ by many decades; the scaling removes that
    Raises numpy.linalg.LinAlgError if the matrix is not positive even with a jitter of 1e-6.
    """

    def __init__(self, matrix: Array) -> None:
        diagonal = np.diag(matrix)
        positive = np.where(diagonal > 0, diagonal, 1.0)
        self.scale = 1.0 / np.sqrt(positive)
        scaled = matrix * self.scale[:, None]
        scaled *= self.scale
        self._root = positive_root(scaled)

    @property
    def root(self) -> Array:
        """Lower triangular root (k, k) of the matrix."""
        return self._root / self.scale[:, None]

    def solve(self, b: Array) -> Array:
        """Solution (k,) or (k, r) of ``matrix x = b``."""
        from scipy.linalg import cho_solve

        scaled = (self.scale * b.T).T
        inner = cho_solve((self._root, True), scaled, check_finite=False)
        return (self.scale * inner.T).T

    def whiten(self, b: Array) -> Array:
        """``L^-1 b`` (k, r): columns whose scalar products are ``b' matrix^-1 b``."""
        from scipy.linalg import solve_triangular

        scaled = b * self.scale[:, None]
        return solve_triangular(
            self._root, scaled, lower=True, check_finite=False
        )

    def inverse(self) -> Array:
        """Inverse (k, k)."""
        size = len(self.scale)
        white = self.whiten(np.eye(size))
        return white.T @ white

    def log_determinant(self) -> float:
        """Logarithm of the matrix's determinant."""
        diagonal = np.diag(self._root) / self.scale
        logarithms = np.log(diagonal)
        return 2 * float(logarithms.sum())


def positive_root(matrix: Array) -> Array:
    """Lower triangular root (k, k) of a matrix, or of one with a little more on its diagonal."""
    raised = matrix.copy()
    for jitter in _JITTERS:
        np.fill_diagonal(raised, np.diag(matrix) + jitter)
        try:
            root = np.linalg.cholesky(raised)
        except np.linalg.LinAlgError:
            continue
        if np.isfinite(np.diag(root)).all():  # a NaN spreads there
            return np.asarray(root)
    raise np.linalg.LinAlgError("the matrix is not positive")


def radius_95(covariance: Array) -> Array:
    """Radius (n,) of the ball that holds 95 % of Gaussians of covariance (n, p, p).

    The squared length is taken as a scaled chi-square of the same mean and variance
    (Satterthwaite 1946), its quantile by Wilson and Hilferty (1931).
    """
    trace = np.einsum("nii->n", covariance)
    squares = covariance**2
    square = squares.sum(axis=(1, 2))
    freedom = trace**2 / np.maximum(square, 1e-300)
    # at least one: a covariance of zeros has none
    ninths = 9 * np.maximum(freedom, 1.0)
    variance = 2 / ninths
    root = 1 - variance + NORMAL_95 * np.sqrt(variance)
    mean = np.maximum(trace, 0.0)
    radius: Array = np.sqrt(mean * root**3)
    return radius


def spread_of(derivative: Array, root: Array) -> Array:
    """Covariances (n, p, p) of predictions: derivatives (n, p, k), root (k, r) of a covariance."""
    n, p, k = derivative.shape
    flat = derivative.reshape(n * p, k)
    roots = flat @ root
    roots = roots.reshape(n, p, -1)
    return roots @ np.swapaxes(roots, 1, 2)


def autocorrelation_time(r: Array) -> float:
    """Integrated autocorrelation time [rows] of residuals (n, m) in the order of the log."""
    n = len(r)
    if n < FIT.fewest_of_time:
        return 1.0
    # a few wrong rows are no correlation
    limit = 4 * np.median(np.abs(r)) + 1e-300
    r = np.clip(r, -limit, limit)
    r = r - r.mean(axis=0)
    power = float((r * r).sum()) + 1e-300
    total = 1.0
    for lag in range(1, min(FIT.longest_time, n // 3)):
        products = r[lag:] * r[:-lag]
        rho = float(products.sum()) / power
        if rho < 2 / np.sqrt(r.size):
            break
        total += 2 * rho
    return total


def root_of(covariance: Array) -> Array:
    """Root (k, k) of a positive semidefinite matrix, a lower triangle."""
    root = Factor(covariance).root
    root[np.diag(covariance) <= 0] = 0.0
    return root


def pack_root(root: Array) -> _Packed:
    """Upper triangular root (k (k + 1) / 2,), row by row, of the covariance of a root (k, r)."""
    k = len(root)
    upper = np.zeros((k, k))
    above = np.triu(root, 1)
    if root.shape == upper.shape and not above.any():
        upper = root.T
    else:
        triangle = np.linalg.qr(root.T, mode="r")
        upper[: len(triangle)] = triangle
    packed = upper[np.triu_indices(k)]
    return packed.astype(np.float32)


def unpack_root(packed: _Packed, size: int) -> Array:
    """The lower triangular root (size, size) that was packed."""
    upper = np.zeros((size, size))
    upper[np.triu_indices(size)] = packed
    return upper.T


def as_kept(root: Array) -> Array:
    """The triangle (k, k) of a root (k, r) in single precision, as a model file keeps it."""
    return unpack_root(pack_root(root), len(root))
