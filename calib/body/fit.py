"""Maximum of the posterior by Gauss-Newton; noise and prior scales by evidence as it goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .covariance import autocorrelation_time
from .derivative import Derivative
from .normal import (
    Factor,
    Sums,
    first_noise,
    information_factor,
    negative_log_likelihood,
    with_prior,
)
from .parameters import Indices, Prior
from .search import Search
from .structure import Structure

MANY = 60
"""Parameters beyond which the information of an earlier step serves where the steps are small."""


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


def maximise(
    structure: Structure,
    q: Array,
    z: Array,
    beta: Array,
    prior: Prior,
    *,
    nu: float,
    floor: Array,
    noise: Array | None = None,
    learn: bool = True,
    steps: int = 10,
    tolerance: float = 1e-2,
    begun: Fit | None = None,
) -> Fit:
    """Fit one member: parameters at the maximum of the posterior, noise and scales by evidence.

    q : (n, dof), joint values [rad or m]
    z : (n, m), what the sensor saw
    beta : (d,), start
    prior : parameters with a zero sd stay at the prior's mean
    nu : degrees of freedom of the Student noise; infinite for Gaussian
    floor : (m,), least noise [unit]
    noise : (m,), noise to start from
    learn : whether noise and scales are learned; otherwise they stay
    steps : most linearisations
    tolerance : a step below this share of the posterior sd ends the search
    begun : a fit of the same rows at `beta`, of which derivatives are taken over
    """
    search = Search(structure, q, z, beta, prior, nu, floor, noise)
    keeps = len(search.active) > MANY and np.isfinite(nu)
    fresh = begun is None or not np.array_equal(begun.active, search.active)
    if begun is not None and not fresh:
        search.x, search.sums = begun.derivative, begun.sums
    # noise and scales follow the steps, and choices of scales are compared three times
    least = 0 if not learn else 3 if any(h.choices for h in search.hypers) else 1
    for it in range(steps):
        search.linearise(fresh)
        if learn and 1 <= it <= 3:
            search.choose()
        delta, variance = search.step(learn)
        share = search.move(delta)
        if learn and share < 0.9:  # the linearised residual is no guide to the noise
            now = first_noise(search.r, floor, structure.blocks)
            search.noise = np.maximum(search.noise, now / 1.2)
        moved = np.abs(delta) / np.sqrt(variance)
        fresh = not keeps or bool(moved.max() > 5.0)
        if share < 0.9:  # old weights led too far: new ones of the same derivatives
            search.sums = []
        if (it >= least and moved.max() <= tolerance) or share == 0.0:
            break
    return _finished(search, fresh)


def _finished(search: Search, fresh: bool) -> Fit:
    """Posterior at the parameters found; `fresh` as in `Search.linearise`."""
    search.linearise(fresh)
    grams, moments = search.summed("grams"), search.summed("moments")
    precision = with_prior(grams.sum(axis=0), search.sd, search.known)
    factor = Factor(precision)
    if not fresh and search.stale(factor):
        return _finished(search, True)
    distance = search.distance(search.beta)
    known = 2 * float(np.log(search.sd).sum())
    if search.known is not None:
        known = -Factor(search.known).log_determinant()
    # Laplace's approximation around the maximum
    evidence = -negative_log_likelihood(search.r, search.noise, search.nu, search.blocks)
    evidence -= 0.5 * (float(distance @ search.pull(distance)) + known)
    evidence -= 0.5 * factor.log_determinant()
    return Fit(
        search.structure,
        search.beta,
        search.active,
        search.sd,
        search.noise,
        search.nu,
        search.r,
        search.x,
        search.w,
        search.sums,
        precision,
        moments.sum(axis=0) - search.pull(distance),
        search.edges,
        grams,
        moments,
        # Rows that err together count once for the time that they do.
        autocorrelation_time(search.r) if np.isfinite(search.nu) else 1.0,
        dict(search.scales),
        evidence,
        search.known,
    )
