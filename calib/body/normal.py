"""Normal equations: a factor of a positive matrix that scales itself."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dpotrf, dpotri, dtrtri

from ..common.arrays import Array


class Factor:
    """Cholesky factor of a symmetric positive matrix after scaling its diagonal to one.

    matrix : (k, k), flat and tight priors differ by many decades; the scaling removes that
    Raises numpy.linalg.LinAlgError if the matrix is not positive even with a jitter of 1e-6.
    """

    def __init__(self, matrix: Array) -> None:
        diagonal = np.diag(matrix)
        self.scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        for jitter in (0.0, 1e-13, 1e-11, 1e-9, 1e-6):
            scaled = matrix * self.scale[:, None]
            scaled *= self.scale
            scaled.flat[:: len(scaled) + 1] += jitter
            # The transpose of a C-ordered array is what LAPACK factors in place, without a copy.
            self._root, failed = dpotrf(
                scaled.T, lower=1, clean=1, overwrite_a=1
            )
            if (
                not failed and np.isfinite(np.diag(self._root)).all()
            ):  # a NaN spreads there
                return
        raise np.linalg.LinAlgError("the matrix is not positive")

    def solve(self, b: Array) -> Array:
        """Solution (k,) or (k, r) of ``matrix x = b``."""
        scale = self.scale if b.ndim == 1 else self.scale[:, None]
        inner = cho_solve((self._root, True), scale * b, check_finite=False)
        solution: Array = scale * inner
        return solution

    def inverse(self) -> Array:
        """Inverse (k, k)."""
        if not len(
            self.scale
        ):  # LAPACK complains of an empty matrix on standard output
            return np.zeros((0, 0))
        # a third of solving for 1; above it are zeros
        inner, _ = dpotri(self._root, lower=1)
        inner += np.tril(inner, -1).T
        inner *= self.scale[:, None]
        inner *= self.scale
        return np.ascontiguousarray(inner)

    def variances(self) -> Array:
        """Diagonal (k,) of the inverse, at half the work of all of it."""
        root, _ = dtrtri(self._root, lower=1)
        squares = np.einsum("ij,ij->j", root, root)
        variances: Array = squares * self.scale**2
        return variances

    def whiten(self, b: Array) -> Array:
        """``L^-1 b`` (k, r): columns whose scalar products are ``b' matrix^-1 b``."""
        scaled = b * self.scale[:, None]
        white: Array = solve_triangular(
            self._root, scaled, lower=True, check_finite=False
        )
        return white

    def log_determinant(self) -> float:
        """Logarithm of the matrix's determinant."""
        root = np.log(np.diag(self._root))
        scale = np.log(self.scale)
        return 2 * float(root.sum() - scale.sum())


def with_prior(gram: Array, sd: Array, precision: Array | None) -> Array:
    """Add a prior's precision to an information (k, k), in place: `precision`, else of sds (k,)."""
    if precision is not None:
        gram += precision
    else:
        gram.flat[:: len(gram) + 1] += sd**-2.0
    return gram
