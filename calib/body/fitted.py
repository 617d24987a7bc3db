"""A fitted member: what leave-block-out, the bound and richer members need of it."""

from __future__ import annotations

from dataclasses import dataclass

from ..common.arrays import Array
from .derivative import Derivative
from .normal import Factor, Sums, information_factor, with_prior
from .structure import Indices, Structure


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
    derivative: Derivative  # (n, m, k)
    weight: Array  # (n, m)
    sums: list[Sums]  # of each block of outputs
    precision: Array  # (k, k), weighted information and prior
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
    def told(self) -> float:
        """Share of the rows' information that is left.

        The Student noise loses some, and residuals that are correlated in the order of the log.
        """
        return information_factor(self.structure, self.nu) / self.autocorrelation

    @property
    def covariance(self) -> Array:
        """Posterior covariance (k, k)."""
        return self.softer(self.grams.sum(axis=0)).inverse()

    def softer(self, gram: Array) -> Factor:
        """Factor of the precision that is left of rows of information `gram` (k, k), and prior."""
        return Factor(with_prior(self.told * gram, self.sd, self.known))
