"""Maximum of the posterior by Gauss-Newton; noise and prior scales by evidence as it goes."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .bound import autocorrelation_time
from .fitted import Fit, by_block
from .normal import Factor, first_noise, information_factor, negative_log_likelihood
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
    weight: Array | None = None,
    learn: bool = True,
    steps: int = 10,
    tolerance: float = 1e-2,
) -> Fit:
    """Fit one member: parameters at the maximum of the posterior, noise and scales by evidence.

    q : (n, dof), joint values [rad or m]
    z : (n, m), what the sensor saw
    beta : (d,), start
    prior : parameters with a zero sd stay at the prior's mean
    nu : degrees of freedom of the Student noise; infinite for Gaussian
    floor : (m,), least noise [unit]
    noise : (m,), noise to start from
    weight : (n,), weights of the rows
    learn : whether noise and scales are learned; otherwise they stay
    steps : most linearisations
    tolerance : a step below this share of the posterior sd ends the search
    """
    search = Search(structure, q, z, beta, prior, nu, floor, noise, weight)
    fresh, keeps = True, len(search.active) > MANY and np.isfinite(nu)
    for it in range(steps):
        search.linearise(fresh)
        if learn and 1 <= it <= 3:
            search.choose()
        delta, variance = search.step(learn)
        share = search.move(delta)
        if learn and share < 0.9:  # the linearised residual is no guide to the noise
            predicted = structure.predict(q, search.beta)
            now = first_noise(structure.residual(z, predicted), floor, structure.blocks)
            search.noise = np.maximum(search.noise, now / 1.2)
        moved = np.abs(delta) / np.sqrt(variance)
        fresh = not keeps or share < 0.9 or bool(moved.max() > 5.0)
        if (it > (2 if learn else 0) and moved.max() <= tolerance) or share == 0.0:
            break
    return _finished(search)


def _finished(search: Search) -> Fit:
    """Posterior at the parameters found."""
    search.see(True)
    edges, grams, moments = by_block(search.x, search.r, search.w, search.noise, search.blocks)
    gram, moment = grams.sum(axis=0), moments.sum(axis=0)
    prior, distance = search.prior, search.distance(search.beta)
    precision = gram + prior
    # Rows that err together count once for the time that they do.
    time = autocorrelation_time(search.r) if np.isfinite(search.nu) else 1.0
    softer = gram * (information_factor(search.structure, search.nu) / time) + prior
    evidence = -negative_log_likelihood(search.r, search.noise, search.nu, search.blocks)
    evidence -= 0.5 * float(distance @ prior @ distance)
    evidence += 0.5 * (Factor(prior).log_determinant() - Factor(precision).log_determinant())
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
        precision,
        Factor(softer).inverse(),
        moment - prior @ distance,
        edges,
        grams,
        moments,
        time,
        dict(search.scales),
        evidence,
        search.known,
    )
