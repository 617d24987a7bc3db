"""Robust regression: linear least squares that a few wrong detections cannot move."""

from __future__ import annotations

import numpy as np

from .arrays import Array

_TUNING = 4.7  # bisquare: 95 % efficient where the noise is Gaussian
_STEPS = 30


def solve_least_squares(features: Array, x: Array, weight: Array | None = None) -> Array:
    """Least squares, of smallest norm where the features depend on each other.

    Features (n, p), x (n, k) and weights (n,) give coefficients (p, k).
    """
    if weight is not None:
        root = np.sqrt(weight)[:, None]
        features, x = features * root, x * root
    size = np.linalg.norm(features, axis=0)
    size = np.where(size > 0, size, 1.0)
    coefficients = np.linalg.lstsq(features / size, x, rcond=1e-9)[0]
    return np.asarray(coefficients / size[:, None])


def robust_solve(features: Array, x: Array) -> Array:
    """Iteratively reweighted least squares: absolute values first, then the bisquare.

    Both columns of `x` share a row's weight: a detection is wrong as a whole.
    """
    coefficients = solve_least_squares(features, x)
    for step in range(_STEPS):
        r = np.linalg.norm(x - features @ coefficients, axis=1)
        middle = float(np.median(r))
        if middle <= 1e-12 * float(np.abs(x).max(initial=0.0)):
            break
        if step < _STEPS // 2:
            weight = 1.0 / np.maximum(r, 0.1 * middle)
        else:
            # the median of a Rayleigh distance is sigma sqrt(2 ln 2): wrong rows do not move it
            z = r / (_TUNING * middle / np.sqrt(2.0 * np.log(2.0)))
            weight = np.where(z < 1.0, (1.0 - np.minimum(z, 1.0) ** 2) ** 2, 0.0)
        before = coefficients
        coefficients = solve_least_squares(features, x, weight)
        moved = np.abs(features @ (coefficients - before)).max()
        if step > _STEPS // 2 and moved < 1e-6 * middle:
            break
    return coefficients
