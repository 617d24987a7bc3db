"""Error curves of single joints: harmonics of the logged joint value with a stationary prior.

A transmission error repeats every turn of a joint; real arms show 8 to 30 cycles a turn.  The
prior variance of harmonic N falls like a Gaussian with a small floor, so that the curve returns to
zero at angles that were never visited.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array

HARMONICS = 48
_WIDTH = 20.0
_FLOOR = 0.003

ORDERS = np.arange(1, HARMONICS + 1)

_KNOTS = 2048
"""Intervals of a turn in a table; a curve of 1 mrad differs from its table by less than 1e-13."""

_PER_RADIAN = _KNOTS / (2 * math.pi)

_Row = tuple[float, float, float, float, float, float]


def curve_shape(*more: float) -> Array:
    """Relative prior variances (96,) of the cosines, then the sines; their mean is 1.

    `more` are the widths [waves a turn] of further Gaussians beside that of `_WIDTH`.
    """
    widths = np.array([_WIDTH, *more])[:, None]
    shape = np.exp(-((ORDERS / widths) ** 2) / 2).sum(axis=0) + _FLOOR
    return np.tile(shape / shape.mean(), 2)


def powers(q: Array) -> NDArray[np.complex128]:
    """``exp(j N q)`` (n, 48) for N = 1..48, by doubling."""
    out = np.empty((len(q), HARMONICS), dtype=complex)
    out[:, 0] = np.exp(1j * q)
    done = 1
    while done < HARMONICS:
        more = min(done, HARMONICS - done)
        np.multiply(out[:, :more], out[:, done - 1 : done], out=out[:, done : done + more])
        done += more
    return out


def curve_value(q: Array, coefficients: Array) -> Array:
    """Curve (n,) [rad] at joint values (n,), by Horner's rule."""
    c = coefficients[:HARMONICS] - 1j * coefficients[HARMONICS:]
    e = np.exp(1j * q)
    total = np.full(len(q), c[-1])
    for k in range(HARMONICS - 2, -1, -1):
        total *= e
        total += c[k]
    return np.asarray((total * e).real)


def curve_slope(q: Array, coefficients: Array) -> Array:
    """Derivative (n,) [rad/rad] of the curve by the joint value."""
    a, b = coefficients[:HARMONICS] * ORDERS, coefficients[HARMONICS:] * ORDERS
    return curve_value(q, np.concatenate([b, -a]))


def curve_rms(coefficients: Array) -> float:
    """Root mean square [rad] of the curve over a turn."""
    return float(np.sqrt((coefficients**2).sum() / 2))


def curve_table(coefficients: Array) -> list[_Row] | None:
    """Coefficients of a quintic for each interval of a turn, in the interval's units.

    They share value, slope and curvature with the curve at both ends (Hermite); None for no curve.
    """
    if not coefficients.any():
        return None
    x = np.linspace(0.0, 2 * np.pi, _KNOTS + 1)
    h = 2 * np.pi / _KNOTS
    f = curve_value(x, coefficients)
    d = curve_slope(x, coefficients) * h
    c = -curve_value(x, coefficients * np.tile(ORDERS, 2) ** 2) * h**2 / 2
    rise, d0, d1, c0, c1 = f[1:] - f[:-1], d[:-1], d[1:], c[:-1], c[1:]
    a, b, e = rise - d0 - c0, d1 - d0 - 2 * c0, c1 - c0
    rows = np.stack(
        [f[:-1], d0, c0, 10 * a - 4 * b + e, -15 * a + 7 * b - 2 * e, 6 * a - 3 * b + e], axis=1
    )
    return [tuple(row) for row in rows.tolist()]


def in_table(table: list[_Row], value: float) -> float:
    """The curve [rad] at one joint value."""
    u = value * _PER_RADIAN
    k = math.floor(u)
    u -= k
    c0, c1, c2, c3, c4, c5 = table[k % _KNOTS]
    return c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))


def in_table_with_slope(table: list[_Row], value: float) -> tuple[float, float]:
    """The curve [rad] and its derivative at one joint value."""
    u = value * _PER_RADIAN
    k = math.floor(u)
    u -= k
    c0, c1, c2, c3, c4, c5 = table[k % _KNOTS]
    slope = c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + 5.0 * u * c5)))
    return c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5)))), _PER_RADIAN * slope
