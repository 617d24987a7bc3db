"""Least squares: linear, and sound where the features depend on each other."""

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
