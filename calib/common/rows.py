"""Rows of numbers: lengths, medians, sums by group, least squares."""

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Index, Mask


def row_lengths(x: Array) -> Array:
    """Return the length of each of the vectors (n, m), quicker than NumPy's norm for a few."""
    return np.asarray(np.sqrt((x * x).sum(axis=1)))


def median_length(x: Array) -> float:
    """Return the median length of vectors (n, m)."""
    return float(np.median(row_lengths(x)))


def rms(values: Array) -> float:
    """Return the root of the mean square of values."""
    return float(np.sqrt(np.mean(values**2)))


def rms_spread(x: Array) -> float:
    """Return the root mean square distance of rows (n, m) from their mean."""
    centred = x - x.mean(axis=0)
    return float(np.sqrt((centred**2).sum(axis=1).mean()))


def diagonal(x: Array) -> float:
    """Return the diagonal of the box that holds rows (n, m)."""
    return float(np.linalg.norm(np.ptp(x, axis=0)))


def finite_rows(x: Array) -> Mask:
    """Return which rows of values (n, m) have finite numbers alone."""
    return np.asarray(np.isfinite(x).all(axis=1))


def spread_rows(count: int, most: int) -> Index:
    """Return at most `most` row numbers of `count`, evenly spread, in order."""
    return np.unique(
        np.linspace(0, count - 1, min(count, most)).round().astype(np.intp)
    )


def thinned(count: int, most: int) -> slice:
    """Return a slice of evenly spaced rows among `count`, at most `most` of them."""
    return slice(None, None, -(-count // most))


def group_sums(
    group: NDArray[np.integer], values: Array, groups: int = 0
) -> Array:
    """Return sums (groups,) or (groups, m) of values (n,) or (n, m) by groups (n,)."""
    if values.ndim == 1:
        return np.bincount(group, values, groups).astype(float)
    sums = [group_sums(group, column, groups) for column in values.T]
    return np.stack(sums, axis=1)


def group_means(
    group: NDArray[np.integer], values: Array, groups: int = 0
) -> Array:
    """Return the means as `group_sums` the sums; NaN of a group without rows."""
    count = np.bincount(group, minlength=groups)
    sums = group_sums(group, values, groups)
    return (sums.T / np.where(count > 0, count, np.nan)).T


def components(count: int, a: Index, b: Index) -> Index:
    """Return the connected component of each of `count` rows that pairs a, b (k,) join."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(a)), (a, b)), (count, count))
    return np.asarray(connected_components(graph)[1], dtype=np.intp)


def solve_least_squares(features: Array, x: Array) -> Array:
    """Least squares, of smallest norm where the features depend on each other.

    Features (n, p) and x (n, k) give coefficients (p, k).
    """
    size = np.linalg.norm(features, axis=0)
    size = np.where(size > 0, size, 1.0)
    coefficients = np.linalg.lstsq(features / size, x, rcond=1e-9)[0]
    return coefficients / size[:, None]
