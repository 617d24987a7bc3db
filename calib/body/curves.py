"""Error curves of single joints: harmonics of the logged joint value with a stationary prior.

A transmission error repeats every turn of a joint.  The prior variance of harmonic N falls like a
Gaussian with a small floor, so that the curve returns to zero at angles that were never visited.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .settings import PRIOR

HARMONICS = 48
ORDERS = np.arange(1, HARMONICS + 1)


def curve_shape(*more: float) -> Array:
    """Relative prior variances (96,) of the cosines, then the sines; their mean is 1.

    `more` are the widths [waves a turn] of further Gaussians beside that of `WIDTH`.
    """
    widths = np.array([PRIOR.width, *more])
    relative = ORDERS / widths[:, None]
    falling = np.exp(-(relative**2) / 2)
    shape = falling.sum(axis=0)
    shape += PRIOR.curve_floor
    shape /= shape.mean()
    return np.tile(shape, 2)


def waves_of(q: Array) -> Array:
    """Cosines, then sines (96, ...) of N q for N = 1..48 at joint values (...), by doubling."""
    waves = np.empty((HARMONICS, *q.shape), dtype=complex)
    waves[0] = np.exp(1j * q)
    count = 1
    while count < HARMONICS:
        more = min(count, HARMONICS - count)
        end = count + more
        waves[count:end] = waves[:more] * waves[count - 1]
        count = end
    return np.concatenate([waves.real, waves.imag])


def curve_value(q: Array, coefficients: Array) -> Array:
    """Curves (k, n) [rad] of coefficients (k, 96) at joint values (k, n)."""
    curves: Array = np.einsum("kc,ckn->kn", coefficients, waves_of(q))
    return curves


def curve_slope(q: Array, coefficients: Array) -> Array:
    """Derivatives (k, n) [rad/rad] of the curves by the joint values, as `curve_value`."""
    cosines, sines = np.split(coefficients, 2, axis=1)
    slopes = np.concatenate([ORDERS * sines, -ORDERS * cosines], axis=1)
    return curve_value(q, slopes)
