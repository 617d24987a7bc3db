"""Normal equations of weighted residuals, and a factor of a positive matrix that scales itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dpotrf, dpotri, dtrtri

from ..common.arrays import Array
from .derivative import Derivative
from .parameters import Indices


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
        return np.asarray(
            solve_triangular(
                self._root,
                np.asfortranarray(b * self.scale[:, None]),
                lower=True,
                overwrite_b=True,
                check_finite=False,
            )
        )

    def log_determinant(self) -> float:
        """Logarithm of the matrix's determinant."""
        return float(2 * np.log(np.diag(self._root)).sum() - 2 * np.log(self.scale).sum())


@dataclass(frozen=True)
class Sums:
    """Weighted sums of one block of outputs, noise not yet divided out, by blocks of rows."""

    grams: Array  # (b, k, k), ``X' W X``
    moments: Array  # (b, k), ``X' W r``
    gram: Array  # (k, k), of all rows
    square: float  # ``r' W r``
    count: int  # number of residuals

    @property
    def moment(self) -> Array:
        """``X' W r`` (k,) of all rows."""
        return np.asarray(self.moments.sum(axis=0))


def slices(blocks: tuple[int, ...]) -> list[slice]:
    """Columns of each block of outputs."""
    edges = np.cumsum((0, *blocks))
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def student_weights(r: Array, noise: Array, nu: float, blocks: tuple[int, ...]) -> Array:
    """Weights (n, m) of residuals (n, m) under Student noise; one weight for each block."""
    out = np.ones_like(r)
    if np.isfinite(nu):
        for part in slices(blocks):
            e2 = ((r[:, part] / noise[part]) ** 2).sum(axis=1)
            p = part.stop - part.start
            out[:, part] = ((nu + p) / (nu + e2))[:, None]
    return out


def sums_of(
    x: Derivative,
    r: Array,
    w: Array,
    blocks: tuple[int, ...],
    edges: Indices,
    old: Sequence[Sums] = (),
) -> list[Sums]:
    """Sums of each block of outputs: derivatives, residuals (n, m) and weights (n, m).

    `edges` (b + 1,) are limits of blocks of rows. With `old` sums their grams are kept, which are
    by far the most work.
    """
    out = []
    for at, part in enumerate(slices(blocks)):
        pulled = w[:, part] * r[:, part]
        parts = [(slice(a, b), x.rows(slice(a, b), part)) for a, b in pairwise(edges)]
        moments = np.stack([some.moment(pulled[rows]) for rows, some in parts])
        grams = old[at].grams if old else np.stack([each.gram(w[r_, part]) for r_, each in parts])
        gram = old[at].gram if old else grams.sum(axis=0)
        square = float((pulled * r[:, part]).sum())
        out.append(Sums(grams, moments, gram, square, pulled.size))
    return out


def with_prior(gram: Array, sd: Array, known: Array | None) -> Array:
    """Add a prior's precision to an information (k, k), in place: `known`, else of sds (k,)."""
    if known is not None:
        gram += known
    else:
        gram.flat[:: len(gram) + 1] += sd**-2.0
    return gram


def first_noise(r: Array, floor: Array, blocks: tuple[int, ...]) -> Array:
    """Noise (m,) from the median residual of each block, at least `floor` (m,)."""
    noise = np.empty(r.shape[1])
    for part in slices(blocks):
        p = part.stop - part.start
        e2 = (r[:, part] ** 2).sum(axis=1)
        noise[part] = 1.2 * np.sqrt(np.median(e2) / (p - 2 / 3))
    return np.maximum(noise, floor)


def student_scale(r: Array, extents: Array, blocks: tuple[int, ...], nu: float) -> Array:
    """Maximum-likelihood Student scale (m,) of residuals, at least 1e-7 of the extents."""
    sigma = np.empty(r.shape[1])
    for part in slices(blocks):
        p, least = part.stop - part.start, 1e-14 * extents[part.start] ** 2
        e2 = (r[:, part] ** 2).sum(axis=1)
        s2 = float(np.median(e2)) / p + least
        for _ in range(12):
            s2 = float(((nu + p) / (nu + e2 / s2) * e2).mean()) / p + least
        sigma[part] = np.sqrt(s2)
    return sigma


def negative_log_likelihood(r: Array, noise: Array, nu: float, blocks: tuple[int, ...]) -> float:
    """Negative logarithm of the likelihood of residuals (n, m), up to a constant."""
    total = 0.0
    for part in slices(blocks):
        e2 = ((r[:, part] / noise[part]) ** 2).sum(axis=1)
        p = part.stop - part.start
        total += len(r) * p * float(np.log(noise[part.start]))
        if np.isfinite(nu):
            total += 0.5 * (nu + p) * float(np.log1p(e2 / nu).sum())
        else:
            total += 0.5 * float(e2.sum())
    return total


def linear_evidence(gram: Array, moment: Array, start: Array, sd: Array) -> float:
    """Log evidence of linearised rows, at `start` beyond the prior's mean, up to a constant."""
    factor = Factor(with_prior(gram.copy(), sd, None))
    pull = moment - start / sd**2
    return 0.5 * float(
        pull @ factor.solve(pull)
        - ((start / sd) ** 2).sum()
        - factor.log_determinant()
        - 2 * np.log(sd).sum()
    )
