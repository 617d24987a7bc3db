"""A fitted member: what leave-block-out, the bound and richer members need of it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .normal import sums_of
from .structure import Array, Indices, Structure

BLOCKS = 10
"""Contiguous blocks of rows whose information is kept apart."""


@dataclass(frozen=True)
class Fit:
    """A member fitted to rows, with what the leave-block-out needs.

    Attributes
    ----------
    structure : Structure
    beta : (d,) array
    active : (k,) int array
    sd : (k,) array
        Prior sd of the active parameters, with the scales that the evidence chose.
    known : (k, k) array or None
        Prior precision where the parameters' priors depend on each other; then not `sd`.
    noise : (m,) array
    nu : float
    residual : (n, m) array
    derivative : (n, m, k) array
    weight : (n, m) array
    precision : (k, k) array
        Weighted information and prior.
    covariance : (k, k) array
        Posterior covariance, with the Student noise's loss of information and that of residuals
        that are correlated in the order of the log.
    gradient : (k,) array
        Of the log posterior: zero at its maximum, not quite where the steps ended before it.
    edges : (b + 1,) int array
        Limits of contiguous blocks of rows.
    grams, moments : (b, k, k) and (b, k) array
        What each block adds to the information and to the gradient.
    autocorrelation : float
        Integrated autocorrelation time of the residuals [rows]; 1 for Gaussian noise.
    scales : dict of str to float
    evidence : float
        Laplace approximation of the logarithm of the evidence.
    """

    structure: Structure
    beta: Array
    active: Indices
    sd: Array
    noise: Array
    nu: float
    residual: Array
    derivative: Array
    weight: Array
    precision: Array
    covariance: Array
    gradient: Array
    edges: Indices
    grams: Array
    moments: Array
    autocorrelation: float
    scales: dict[str, float]
    evidence: float
    known: Array | None = None

    @property
    def prior(self) -> Array:
        """Prior precision (k, k)."""
        return np.diag(self.sd**-2.0) if self.known is None else self.known


def by_block(
    x: Array, r: Array, w: Array, noise: Array, blocks: tuple[int, ...]
) -> tuple[Indices, Array, Array]:
    """Limits (b + 1,) of contiguous blocks of rows; their information (b, k, k), moments (b, k)."""
    edges = np.linspace(0, len(r), min(BLOCKS, len(r)) + 1).round().astype(int)
    grams, moments = [], []
    for a, b in pairwise(edges):
        sums = sums_of(x[a:b] / noise[:, None], r[a:b] / noise, w[a:b], blocks)
        grams.append(np.sum([s.gram for s in sums], axis=0))
        moments.append(np.sum([s.moment for s in sums], axis=0))
    return edges, np.stack(grams), np.stack(moments)
