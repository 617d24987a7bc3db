"""The judge of clocks for planar arms: a chain under a tilted camera, clocks fitted with it.

A chain has a dozen parameters, so ten postures say what three hundred must say to a fit
without one, and few milliseconds show: without a chain the offsets of half a minute of a planar arm
are off by up to 38 ms (3 with it).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..errors import CalibError

_STEPS = 12
_NU = 4.0  # degrees of freedom of the noise: a track has outliers
_RATE_SD = 4e-3  # how much rates of clocks differ

_Timing = tuple[Array, Array, float]
"""Offset [s] and rate, added to those of the rows (2,), their standard deviations (2,), and the
median distance of the rows from the chain [px]."""


def fit_timing(
    time: Array, x: Array, joints: Callable[[Array], Array], revolute: tuple[bool, ...]
) -> _Timing | None:
    """Fit a chain, a view, an offset of clocks and, where the track shows one, their rate.

    time, x : (n,) array [s], (n, 2) array; joints' times of the rows as far as known, and the
        track.
    joints : callable; returns joints (n, dof) at joints' times (n,).
    Returns None where no chain can be fitted.
    """
    from ..body.planar import planar_structure
    from ..body.starts import best_starts  # both bring SciPy's linear algebra

    q = joints(time)
    names = tuple(f"q{k}" for k in range(q.shape[1]))
    try:
        template = planar_structure(x, names, revolute, None, "homography", "px", False)
        chain = dict(template.members())["chain"]
        start = best_starts(template, q, x, chain)[0]
        structure, beta = start.structure, start.beta
        prior = structure.prior((*chain, "lens"))
    except (CalibError, np.linalg.LinAlgError):
        return None
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        plain, beta = _search(structure, prior, time, x, joints, beta, 0.0, 1e-12)
        if plain is None:
            return None
        free, _ = _search(structure, prior, time, x, joints, beta, plain[0][0], _RATE_SD)
    if free is None or not shows_rate(free[0][1], free[1][1], free[2], plain[2]):
        return plain
    return free


def shows_rate(rate: float, sd: float, error: float, plain: float) -> bool:
    """Whether rows show a rate, by their error with and without: noise would spoil both ends."""
    return abs(rate) > 4.0 * sd and error < 0.97 * plain


def _search(
    structure: Any,
    prior: Any,
    time: Array,
    x: Array,
    joints: Callable[[Array], Array],
    beta: Array,
    offset: float,
    rate_sd: float,
) -> tuple[_Timing | None, Array]:
    """Fit a chain and the clocks together; return the clocks and the chain's parameters.

    Gauss and Newton's method from parameters and an offset, priors as further rows.
    """
    active = np.flatnonzero(prior.sd > 0)
    mean, since, k = prior.mean[active], time - 0.5 * (time[0] + time[-1]), len(active)
    beta, clock, h = beta.copy(), np.array([offset, 0.0]), 5e-3
    sd = np.r_[prior.sd[active], 0.2, rate_sd]
    for _ in range(_STEPS):
        when = time + clock[0] + clock[1] * since
        q = joints(when)
        seen, slopes = structure.linearise(q, beta, active)
        speed = (joints(when + h) - joints(when - h)) / (2.0 * h)
        velocity = np.einsum("nmd,nd->nm", structure.slope(q, beta), speed)
        J = np.concatenate(
            [slopes, velocity[..., None], (velocity * since[:, None])[..., None]], axis=2
        )
        miss = x - seen
        distance = np.linalg.norm(miss, axis=1)
        if not np.isfinite(distance).all():
            return None, beta
        # 1.18 is the median distance of two independent normal errors of size one
        scale = max(float(np.median(distance)) / 1.18, 0.01)
        # of a Student t in two dimensions: what is far from the chain counts for little
        weight = (_NU + 2.0) / (_NU + (distance / scale) ** 2) / scale**2
        JW = (J * weight[:, None, None]).reshape(-1, len(sd))
        precision = JW.T @ J.reshape(-1, len(sd)) + np.diag(1.0 / sd**2)
        gradient = JW.T @ miss.ravel()
        gradient[:k] -= (beta[active] - mean) / sd[:k] ** 2
        gradient[k:] -= clock / sd[k:] ** 2
        step = np.linalg.solve(precision, gradient)
        # far from the solution the velocity is a poor guide
        step *= min(1.0, 0.08 / max(abs(float(step[-2])), 1e-12))
        beta[active] += step[:k]
        clock += step[k:]
        if np.abs(step[-2:] * [1.0, np.ptp(time)]).max() < 1e-5:
            break
    # neighbouring rows err alike: about three of them say as much as one
    spread = np.sqrt(3.0 * np.diag(np.linalg.inv(precision))[-2:])
    return (clock, spread, float(np.median(distance))), beta
