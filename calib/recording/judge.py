"""How well joints predict what was seen: the judge of clocks and of the order of rows.

Ridge regression on the products of the joints' harmonics, in which the tip of any arm and,
closely, its pixels are linear. Blocks of neighbouring rows are held out, in closed form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST = 240
"""Rows that are judged at once; of more, so many are taken evenly."""

_SOFT = (1e-6, 1e-4, 1e-2)  # ridge, relative to the kernel's one


def kernel(q: Array, other: Array) -> Array:
    """Return the covariance (n, m) of harmonics up to the second of each joint."""
    result = np.ones((len(q), len(other)))
    for a, b in zip(q.T, other.T, strict=True):
        c = np.cos(a[:, None] - b[None])
        result *= 0.45 + 0.45 * c + 0.1 * (2.0 * c**2 - 1.0)
    return result


def thinned(count: int, most: int = MOST) -> NDArray[np.intp]:
    """Return so many row numbers of `count`, evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))


def held_out(q: Array, x: Array, blocks: int = 8) -> Array:
    """Predict each row by the rows of other blocks.

    Parameters
    ----------
    q : (n, joints) array [rad or m]
        Joints, in the order of time.
    x : (n, d) array
        What was seen with them.
    blocks : int
        Neighbouring rows are left out together: so many times.

    Returns
    -------
    (n,) array [unit of x]
        Distances of the predictions, with the softness that has the least median.
    """
    n = len(q)
    K = kernel(q, q)
    parts = [p for p in np.array_split(np.arange(n), min(blocks, n)) if len(p)]
    best = np.full(n, np.inf)
    for soft in _SOFT:
        inverse = np.linalg.inv(K + 1.0 + soft * np.eye(n))  # the one is a free mean
        weights = inverse @ (x - x.mean(0))
        miss = np.empty_like(x)
        for part in parts:
            miss[part] = np.linalg.solve(inverse[np.ix_(part, part)], weights[part])
        distance = np.linalg.norm(miss, axis=1)
        if np.median(distance) < np.median(best):
            best = distance
    return best


def row_shift(q: Array, x: Array, most: int = 3) -> tuple[int, float, float]:
    """Find whether the joints of a neighbour row fit better than a row's own.

    Returns
    -------
    shift : int
        How many rows further down the joints of a row are; 0 where they fit as they are.
    own, other : float [unit of x]
        Median distances that blocks of rows are predicted to, as they are and shifted.
    """
    n = len(q)
    if n < 12 + 2 * most:
        return 0, np.nan, np.nan
    some = slice(most, n - most)
    medians = {}
    for shift in range(-most, most + 1):
        rows = np.arange(n)[some] + shift
        take = thinned(len(rows))
        medians[shift] = float(np.median(held_out(q[rows][take], x[some][take])))
    best = min(medians, key=lambda s: medians[s])
    own = medians[0]
    return (best if medians[best] < 0.4 * own else 0), own, medians[best]
