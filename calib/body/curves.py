"""Error curves of single joints: harmonics of the logged joint value with a stationary prior.

A transmission error repeats every turn of a joint, so that its curve is a Fourier series::

    curve(q) = sum_N a_N cos(N q) + b_N sin(N q),    N = 1..48

The prior variance of harmonic N falls like a Gaussian with a small floor, so that the curve returns
to zero at angles that were never visited.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .settings import PRIOR

HARMONICS = 48
ORDERS = np.arange(1, HARMONICS + 1)

Amplitudes = NDArray[np.complex128]
"""Of powers exp(i N q), whose sums' real parts are curves."""


def curve_shape(*more: float) -> Array:
    """Relative prior variances (96,) of the cosines, then the sines; their mean is 1.

    `more` are the widths [waves a turn] of further Gaussians, added to that of `PRIOR.width`.
    """
    widths = np.array([PRIOR.width, *more])
    relative = ORDERS / widths[:, None]
    gaussians = np.exp(-(relative**2) / 2)
    shape = gaussians.sum(axis=0)
    shape += PRIOR.curve_floor
    shape /= shape.mean()
    return np.tile(shape, 2)


def powers_of(q: Array, count: int) -> Amplitudes:
    """Powers exp(i N q) (count, ...) for N = 1..count at joint values (...) [rad]."""
    powers = np.empty((count, *q.shape), dtype=complex)
    powers[0] = np.exp(1j * q)
    end = 1
    # twice as many each time: the first ones times the last one
    while end < count:
        start = end
        end = min(2 * start, count)
        last = powers[start - 1]
        powers[start:end] = powers[: end - start] * last
    return powers


def waves_of(q: Array) -> Array:
    """Cosines, then sines (96, ...) of N q for N = 1..48 at joint values (...) [rad]."""
    powers = powers_of(q, HARMONICS)
    return np.concatenate([powers.real, powers.imag])


def amplitudes_of(coefficients: Array) -> Amplitudes:
    """Amplitudes (k, 48) of curves of coefficients (k, 96)."""
    return coefficients[:, :HARMONICS] - 1j * coefficients[:, HARMONICS:]


def curve_value(q: Array, amplitudes: Amplitudes) -> Array:
    """Curves (k, n) [rad] of amplitudes (k, 48) at joint values (k, n).

    A polynomial of exp(i q) by Horner's rule, a block of powers at a time.  That of their
    derivatives [rad/rad] has the amplitudes ``i N``.
    """
    size = 8  # powers of one matrix product
    count = HARMONICS // size
    blocks = amplitudes.reshape(len(q), count, size)
    powers = powers_of(q, size)
    sums = blocks @ np.swapaxes(powers, 0, 1)
    curves = sums[:, -1]
    for block in reversed(range(count - 1)):
        curves = curves * powers[-1] + sums[:, block]
    return curves.real.copy()
