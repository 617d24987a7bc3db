"""Normal equations: a factor of a positive matrix that scales itself."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array

_JITTERS = (0.0, 1e-13, 1e-11, 1e-9, 1e-6)


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
