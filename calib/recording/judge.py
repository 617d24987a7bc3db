"""How well joints predict what was seen: the judge of clocks and of the order of rows.

Ridge regression on the products of the joints' harmonics, in which the tip of any arm and,
closely, its pixels are linear. Blocks of neighbouring rows are held out, in closed form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.thinning import thinned

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


class Judge:
    """A fit of what was seen by joints, from which blocks of rows are held out.

    Joints `q` (n, joints) are in the order of time; neighbouring rows are left out together,
    `blocks` times; `soft` is the ridge, relative to the kernel's one.
    """

    def __init__(self, q: Array, blocks: int = 8, soft: float = _SOFT[1]) -> None:
        n = len(q)
        self.q = q
        self._inverse = np.linalg.inv(kernel(q, q) + 1.0 + soft * np.eye(n))  # one: a free mean
        self._parts = [p for p in np.array_split(np.arange(n), min(blocks, n)) if len(p)]

    def miss(self, x: Array) -> Array:
        """Return what the other blocks' fit leaves of values (n, d): linear in them."""
        weights = self._inverse @ (x - x.mean(0))
        miss: Array = np.empty_like(weights)
        for part in self._parts:
            miss[part] = np.linalg.solve(self._inverse[np.ix_(part, part)], weights[part])
        return miss

    def error(self, x: Array) -> float:
        """Return the median distance that values (n, d) are missed by."""
        return float(np.median(np.linalg.norm(self.miss(x), axis=1)))

    def predict(self, q: Array, x: Array) -> Array:
        """Return what the fit to values (n, d) of all rows says at joints (m, joints)."""
        middle = x.mean(0)
        return np.asarray((kernel(q, self.q) + 1.0) @ (self._inverse @ (x - middle)) + middle)


def held_out(q: Array, x: Array, blocks: int = 8) -> Array:
    """Return how far each row is predicted by the rows of other blocks (n,) [unit of x].

    Joints (n, joints) are in the order of time, x (n, d) is what was seen with them; neighbouring
    rows are left out together, `blocks` times, with the softness that has the least median.
    """
    return np.asarray(np.linalg.norm(Judge(q, blocks, softness(q, x, blocks)).miss(x), axis=1))


def softness(q: Array, x: Array, blocks: int = 8) -> float:
    """Return the ridge with which held-out blocks are predicted best."""
    return min(_SOFT, key=lambda soft: Judge(q, blocks, soft).error(x))


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
        take = thinned(len(rows), MOST)
        medians[shift] = float(np.median(held_out(q[rows][take], x[some][take])))
    best = min(medians, key=lambda s: medians[s])
    own = medians[0]
    return (best if medians[best] < 0.4 * own else 0), own, medians[best]
