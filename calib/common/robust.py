"""Robust regression: linear least squares that a few wrong detections cannot move."""

import numpy as np

from .arrays import Array


def solve_least_squares(features: Array, x: Array) -> Array:
    """Least squares, of smallest norm where the features depend on each other.

    Features (n, p) and x (n, k) give coefficients (p, k).
    """
    size = np.linalg.norm(features, axis=0)
    size = np.where(size > 0, size, 1.0)
    coefficients = np.linalg.lstsq(features / size, x, rcond=1e-9)[0]
    return coefficients / size[:, None]


def robust_solve(
    features: Array, x: Array, tuning: float = 4.7, steps: int = 15
) -> Array:
    """Iteratively reweighted least squares: absolute values first, then the bisquare.

    All columns of `x` share a row's weight: a detection is wrong as a whole. `tuning` 4.7 is 95 %
    efficient where the noise is Gaussian; each of both weights has so many `steps`.
    """
    coefficients = solve_least_squares(features, x)
    for step in range(2 * steps):
        r = np.linalg.norm(x - features @ coefficients, axis=1)
        middle = float(np.median(r))
        if middle <= 1e-12 * float(np.abs(x).max(initial=0.0)):
            break
        # the median of a Rayleigh distance is sigma sqrt(2 ln 2): wrong rows do not move it
        z = r / (tuning * middle / np.sqrt(2.0 * np.log(2.0)))
        root = 1.0 - np.minimum(z, 1.0) ** 2  # of the weight
        if step < steps:
            root = np.maximum(r, 0.1 * middle) ** -0.5
        before = coefficients
        coefficients = solve_least_squares(
            root[:, None] * features, root[:, None] * x
        )
        moved = np.abs(features @ (coefficients - before)).max()
        if step > steps and moved < 1e-6 * middle:
            break
    return coefficients
