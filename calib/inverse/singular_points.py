"""Folds: where two branches meet, because the arm is stretched or folded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from .newton import Newton

SINGULAR = 0.3
"""Sine between the motions of both joints below which a fold may be near."""

_FINE = 0.1  # the same between solutions, for twins of a map whose nodes stand close
_COARSE = 5.0  # and per node spacing, where they do not
_PROBE = 1e-4  # of the joints' range: step of the derivative of the determinant
_FAR = 0.3  # of the joints' range: a twin is not looked for further away


def twins(newton: Newton, u: Array, spacing: float = 0.0) -> tuple[Index, Array]:
    """Starts (m, 2) for the solutions across a nearby fold of `u` (n, 2), and of which rows (m,).

    A Jacobian of determinant zero is a fold: two solutions meet there. Along the direction that
    hardly moves the tip the determinant falls linearly to zero, and the other solution lies about
    as far beyond as this one lies before. A coarse map, its nodes `spacing` apart in the unit box,
    overlooks branches that are further apart, so that twins are looked for further away.
    """
    slope = newton.predictor.value_and_slope(u)[1]
    share = min(max(_FINE, _COARSE * spacing), SINGULAR)
    rows = np.flatnonzero(singular(slope, share))
    if not len(rows):
        return rows, u[rows]
    # the right singular vector of the smaller singular value
    flat = np.linalg.svd(slope[rows])[2][:, 1]
    ahead = _determinant(newton.predictor.value_and_slope(u[rows] + _PROBE * flat)[1])
    behind = _determinant(newton.predictor.value_and_slope(u[rows] - _PROBE * flat)[1])
    rate = (ahead - behind) / (2 * _PROBE)
    reach = -2.0 * _determinant(slope[rows]) / np.where(rate == 0.0, np.inf, rate)
    near = (np.abs(reach) < _FAR) & (reach != 0.0)
    rows = rows[near]
    return rows, newton.clip(u[rows] + reach[near, None] * flat[near])


def singular(slope: Array, share: float) -> NDArray[np.bool_]:
    """Whether both joints move the tip along nearly the same line, (n,).

    The determinant of the Jacobians (n, 2, 2) over the lengths of their columns is the sine
    of the angle between them.
    """
    first, second = np.einsum("nij,nij->jn", slope, slope)
    return np.asarray(np.abs(_determinant(slope)) < share * np.sqrt(first * second))


def _determinant(slope: Array) -> Array:
    return np.asarray(slope[:, 0, 0] * slope[:, 1, 1] - slope[:, 0, 1] * slope[:, 1, 0])
