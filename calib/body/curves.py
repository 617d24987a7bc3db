"""Error curves of single joints: harmonics of the logged joint value with a stationary prior.

A transmission error repeats every turn of a joint.  The prior variance of harmonic N falls like a
Gaussian with a small floor, so that the curve returns to zero at angles that were never visited.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .settings import CURVE_FLOOR, WIDTH

HARMONICS = 48
ORDERS = np.arange(1, HARMONICS + 1)

_ROWS = 128  # at once: what is held of them fits into the cache


def curve_shape(*more: float) -> Array:
    """Relative prior variances (96,) of the cosines, then the sines; their mean is 1.

    `more` are the widths [waves a turn] of further Gaussians beside that of `WIDTH`.
    """
    widths = np.array([WIDTH, *more])[:, None]
    shape = np.exp(-((ORDERS / widths) ** 2) / 2).sum(axis=0) + CURVE_FLOOR
    return np.tile(shape / shape.mean(), 2)


def waves_of(q: Array) -> Array:
    """Cosines, then sines (96, n) of N q for N = 1..48 at joint values (n,), by doubling."""
    out = np.empty((HARMONICS, len(q)), dtype=complex)
    out[0], done = np.exp(1j * q), 1
    while done < HARMONICS:
        more = min(done, HARMONICS - done)
        np.multiply(out[:more], out[done - 1], out=out[done : done + more])
        done += more
    return np.concatenate([out.real, out.imag])


def curve_value(q: Array, coefficients: Array) -> Array:
    """Curve (n,) [rad] at joint values (n,), or curves (k, n) at (k, n), by Estrin's scheme."""
    if q.shape[-1] > _ROWS:
        parts = (q[..., i : i + _ROWS] for i in range(0, q.shape[-1], _ROWS))
        return np.concatenate([curve_value(part, coefficients) for part in parts], axis=-1)
    c = coefficients[..., :HARMONICS, None] - 1j * coefficients[..., HARMONICS:, None]
    e = power = np.exp(1j * q)[..., None, :]
    while c.shape[-2] > 3:  # neighbours in pairs: 48 terms, 24, 12, 6, 3
        c, power = c[..., ::2, :] + power * c[..., 1::2, :], power * power
    total = c[..., :1, :] + power * (c[..., 1:2, :] + power * c[..., 2:, :])
    return np.asarray((total * e)[..., 0, :].real)


def curve_slope(q: Array, coefficients: Array) -> Array:
    """Derivative [rad/rad] of the curve by the joint value, as `curve_value`."""
    a, b = coefficients[..., :HARMONICS] * ORDERS, coefficients[..., HARMONICS:] * ORDERS
    return curve_value(q, np.concatenate([b, -a], axis=-1))
