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
    """Cosines, then sines (96, n) of N q for N = 1..48 at joint values (n,), by doubling."""
    waves = np.empty((HARMONICS, len(q)), dtype=complex)
    waves[0] = np.exp(1j * q)
    count = 1
    while count < HARMONICS:
        more = min(count, HARMONICS - count)
        end = count + more
        waves[count:end] = waves[:more] * waves[count - 1]
        count = end
    return np.concatenate([waves.real, waves.imag])


def curve_value(q: Array, coefficients: Array) -> Array:
    """Curve (n,) [rad] at joint values (n,), or curves (k, n) at (k, n), by Estrin's scheme."""
    cosines, sines = np.split(coefficients.T[..., None], 2)
    terms = cosines - 1j * sines
    wave = np.exp(1j * q)
    power = wave
    while len(terms) > 3:  # neighbours in pairs: 48 terms, 24, 12, 6, 3
        terms = terms[::2] + power * terms[1::2]
        power = power * power
    total = terms[1] + power * terms[2]
    total = terms[0] + power * total
    curve: Array = (total * wave).real
    return curve


def curve_slope(q: Array, coefficients: Array) -> Array:
    """Derivative [rad/rad] of the curve by the joint value, as `curve_value`."""
    cosines, sines = np.split(coefficients, 2, axis=-1)
    parts = [ORDERS * sines, -ORDERS * cosines]
    return curve_value(q, np.concatenate(parts, axis=-1))
