"""A fitted member: what leave-block-out, the bound and richer members need of it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..common.arrays import Array
from .normal import sums_of
from .structure import Indices, Structure

BLOCKS = 10
"""Contiguous blocks of rows whose information is kept apart."""


@dataclass(frozen=True)
class Fit:
    """A member fitted to rows, with what the leave-block-out needs."""

    structure: Structure
    beta: Array  # (d,)
    active: Indices  # (k,)
    sd: Array  # (k,), prior sd of the active parameters, with the scales that the evidence chose
    noise: Array  # (m,)
    nu: float
    residual: Array  # (n, m)
    derivative: Array  # (n, m, k)
    weight: Array  # (n, m)
    precision: Array  # (k, k), weighted information and prior
    # (k, k), posterior covariance, with the Student noise's loss of information and that of
    # residuals that are correlated in the order of the log
    covariance: Array
    # (k,), of the log posterior: zero at its maximum, not quite where the steps ended before it
    gradient: Array
    edges: Indices  # (b + 1,), limits of contiguous blocks of rows
    # (b, k, k) and (b, k) array, what each block adds to the information and to the gradient
    grams: Array
    moments: Array
    # integrated autocorrelation time of the residuals [rows]; 1 for Gaussian noise
    autocorrelation: float
    scales: dict[str, float]
    evidence: float  # Laplace approximation of the logarithm of the evidence
    # (k, k), prior precision where the parameters' priors depend on each other; then not `sd`
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
