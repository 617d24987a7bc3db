"""Error curves of single joints: harmonics of the logged joint value with a stationary prior.

A transmission error repeats every turn of a joint, so that its curve is a Fourier series::

    curve(q) = sum_N a_N cos(N q) + b_N sin(N q),    N = 1..48

The prior variance of harmonic N falls like a Gaussian with a small floor, so that the curve returns
to zero at angles that were never visited.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .settings import PRIOR

HARMONICS = 48
ORDERS = np.arange(1, HARMONICS + 1)


def curve_shape(*more: float) -> Array:
    """Relative prior variances (96,) of the cosines, then the sines; their mean is 1.

    `more` are the widths [waves a turn] of further Gaussians beside that of `PRIOR.width`.
    """
    widths = np.array([PRIOR.width, *more])
    relative = ORDERS / widths[:, None]
    gaussians = np.exp(-(relative**2) / 2)
    shape = gaussians.sum(axis=0)
    shape += PRIOR.curve_floor
    shape /= shape.mean()
    return np.tile(shape, 2)


def waves_of(q: Array) -> Array:
    """Cosines, then sines (96, ...) of N q for N = 1..48 at joint values (...) [rad]."""
    powers = np.empty((HARMONICS, *q.shape), dtype=complex)  # exp(i N q)
    powers[0] = np.exp(1j * q)
    count = 1
    # twice as many each time: the first ones times the last one
    while count < HARMONICS:
        end = min(2 * count, HARMONICS)
        last = powers[count - 1]
        powers[count:end] = powers[: end - count] * last
        count = end
    return np.concatenate([powers.real, powers.imag])


def curve_value(q: Array, coefficients: Array) -> Array:
    """Curves (k, n) [rad] of coefficients (k, 96) at joint values (k, n)."""
    waves = waves_of(q)
    curves: Array = np.einsum("kc,ckn->kn", coefficients, waves)
    return curves


def curve_slope(q: Array, coefficients: Array) -> Array:
    """Derivatives (k, n) [rad/rad] of the curves by the joint values, as `curve_value`."""
    cosines, sines = np.split(coefficients, 2, axis=1)
    of_cosines = ORDERS * sines
    of_sines = -ORDERS * cosines
    slopes = np.concatenate([of_cosines, of_sines], axis=1)
    return curve_value(q, slopes)
