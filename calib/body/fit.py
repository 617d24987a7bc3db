"""Maximum of the posterior by Gauss-Newton; noise and prior scales by evidence as it goes."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .bound import autocorrelation_time
from .fitted import Fit
from .normal import Factor, first_noise, negative_log_likelihood, with_prior
from .search import Search
from .structure import Prior, Structure

MANY = 60
"""Parameters beyond which the information of an earlier step serves where the steps are small."""


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
    grams, moments = search.by_block()
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
