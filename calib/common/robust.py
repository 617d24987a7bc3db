"""Robust regression: linear least squares that a few wrong detections cannot move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TUNING = 4.7  # bisquare: 95 % efficient where the noise is Gaussian
_STEPS = 30
_GROSS = 7.0  # medians of a residual beyond which a row is a wrong detection
_SPREAD = 3.0  # and beyond so many times what four in five rows stay below
_MOST = 0.25  # share of the rows that can be wrong


def solve(features: Array, x: Array, weight: Array | None = None) -> Array:
    """Least squares, of smallest norm where the features depend on each other.

    Parameters
    ----------
    features : (n, p) array
    x : (n, k) array
    weight : (n,) array, optional

    Returns
    -------
    (p, k) array
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
    coefficients = solve(features, x)
    for step in range(_STEPS):
        r = np.linalg.norm(x - features @ coefficients, axis=1)
        middle = float(np.median(r))
        if middle <= 1e-12 * float(np.abs(x).max(initial=0.0)):
            break
        if step < _STEPS // 2:
            weight = 1.0 / np.maximum(r, 0.1 * middle)
        else:
            z = r / (_TUNING * middle / np.sqrt(2.0 * np.log(2.0)))
            weight = np.where(z < 1.0, (1.0 - np.minimum(z, 1.0) ** 2) ** 2, 0.0)
        before = coefficients
        coefficients = solve(features, x, weight)
        moved = np.abs(features @ (coefficients - before)).max()
        if step > _STEPS // 2 and moved < 1e-6 * middle:
            break
    return coefficients


def inliers(candidates: list[Array], x: Array) -> NDArray[np.bool_]:
    """Rows that are no gross outliers from the robust fit that suits the rows best.

    Parameters
    ----------
    candidates : list of (n, p) array
        Features, one array for each fit; those with too many for the rows are left out.
    x : (n, 2) array

    Returns
    -------
    (n,) bool array
        All rows where more than a quarter would be outliers: then the fit is wrong.
    """
    best: Array | None = None
    for features in candidates:
        if len(x) < 2 * features.shape[1] + 4:
            continue
        r = np.linalg.norm(x - features @ robust_solve(features, x), axis=1)
        if best is None or np.median(r) < np.median(best):
            best = r
    if best is None:
        return np.ones(len(x), dtype=bool)
    floor = 1e-7 * float(np.linalg.norm(np.ptp(x, axis=0)))
    limit = max(_GROSS * float(np.median(best)), _SPREAD * float(np.quantile(best, 0.8)), floor)
    good = best <= limit
    if np.count_nonzero(good) < (1 - _MOST) * len(x):
        return np.ones(len(x), dtype=bool)
    return np.asarray(good)
