"""Normal equations: a factor of a positive matrix that scales itself, and Student residuals."""

from __future__ import annotations

from itertools import pairwise

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
            self._root, failed = dpotrf(scaled.T, lower=1, clean=1, overwrite_a=1)
            if not failed and np.isfinite(np.diag(self._root)).all():  # a NaN spreads there
                return
        raise np.linalg.LinAlgError("the matrix is not positive")

    def solve(self, b: Array) -> Array:
        """Solution (k,) or (k, r) of ``matrix x = b``."""
        s = self.scale if b.ndim == 1 else self.scale[:, None]
        return np.asarray(s * cho_solve((self._root, True), s * b, check_finite=False))

    def inverse(self) -> Array:
        """Inverse (k, k)."""
        if not len(self.scale):  # LAPACK complains of an empty matrix on standard output
            return np.zeros((0, 0))
        inner = dpotri(self._root, lower=1)[0]  # a third of solving for 1; above it are zeros
        inner += np.tril(inner, -1).T
        inner *= self.scale[:, None]
        inner *= self.scale
        return np.ascontiguousarray(inner)

    def variances(self) -> Array:
        """Diagonal (k,) of the inverse, at half the work of all of it."""
        root = dtrtri(self._root, lower=1)[0]
        return np.asarray(np.einsum("ij,ij->j", root, root) * self.scale**2)

    def whiten(self, b: Array) -> Array:
        """``L^-1 b`` (k, r): columns whose scalar products are ``b' matrix^-1 b``."""
        scaled = np.asfortranarray(b * self.scale[:, None])
        return np.asarray(
            solve_triangular(self._root, scaled, lower=True, overwrite_b=True, check_finite=False)
        )

    def log_determinant(self) -> float:
        """Logarithm of the matrix's determinant."""
        return float(2 * np.log(np.diag(self._root)).sum() - 2 * np.log(self.scale).sum())


def with_prior(gram: Array, sd: Array, known: Array | None) -> Array:
    """Add a prior's precision to an information (k, k), in place: `known`, else of sds (k,)."""
    if known is not None:
        gram += known
    else:
        gram.flat[:: len(gram) + 1] += sd**-2.0
    return gram


def slices(blocks: tuple[int, ...]) -> list[slice]:
    """Columns of each block of outputs."""
    edges = np.cumsum((0, *blocks))
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def _squares(r: Array, blocks: tuple[int, ...]) -> list[tuple[slice, int, Array]]:
    """Columns, number and squared lengths (n,) of the residuals of each block of outputs."""
    parts = slices(blocks)
    return [(part, part.stop - part.start, (r[:, part] ** 2).sum(axis=1)) for part in parts]


def student_weights(r: Array, noise: Array, nu: float, blocks: tuple[int, ...]) -> Array:
    """Weights (n, m) of residuals (n, m) under Student noise; one weight for each block."""
    out = np.ones_like(r)
    if np.isfinite(nu):
        for part, p, e2 in _squares(r, blocks):
            out[:, part] = ((nu + p) / (nu + e2 / noise[part.start] ** 2))[:, None]
    return out


def noise_of(
    r: Array, floor: Array, nu: float, blocks: tuple[int, ...], used: float = 0.0
) -> Array:
    """Most probable scale (m,) of residuals (n, m), of which `used` numbers were fitted.

    floor : (m,), the least
    """
    noise = np.empty(r.shape[1])
    for part, p, e2 in _squares(r, blocks):
        count, least = p * len(r), max(floor[part.start] ** 2, 1e-300)
        free = max(count - used * p / r.shape[1], count / 4 + 1)
        s2 = max(float(np.median(e2)) / p, least)
        for _ in range(12 if np.isfinite(nu) else 1):
            weight = (nu + p) / (nu + e2 / s2) if np.isfinite(nu) else 1.0
            s2 = max(float((weight * e2).sum()) / free, least)
        noise[part] = np.sqrt(s2)
    return noise


def negative_log_likelihood(r: Array, noise: Array, nu: float, blocks: tuple[int, ...]) -> float:
    """Negative logarithm of the likelihood of residuals (n, m), up to a constant."""
    total = 0.0
    for part, p, e2 in _squares(r, blocks):
        s = float(noise[part.start])
        total += len(r) * p * np.log(s)
        if np.isfinite(nu):
            total += 0.5 * (nu + p) * float(np.log1p(e2 / s**2 / nu).sum())
        else:
            total += 0.5 * float(e2.sum()) / s**2
    return total
