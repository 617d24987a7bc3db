"""How well joints predict what was seen: the judge of clocks and of the order of rows.

Ridge regression on the products of the joints' harmonics, in which the tip of any arm and,
closely, its pixels are linear. Blocks of neighbouring rows are held out, in closed form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.rows import thinned

Array = NDArray[np.float64]

MOST = 240
"""Rows that are judged at once; of more, so many are taken evenly."""

_SEARCHED = 120  # rows that each of some eighty shifts is judged by
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


def row_shift(q: Array, x: Array, most: int = 3) -> tuple[int, int, float, float]:
    """Find a row from which on the joints of a neighbour row fit better than a row's own.

    A picture that is missing leaves the rows before it right, so that every row may be the first.

    Returns
    -------
    start, shift : int
        That row, and how many rows further down its joints are; 0 where rows fit as they are.
    own, other : float [unit of x]
        Mean distances that blocks of rows are predicted to, as they are and shifted.
    """
    n = len(q)

    def error(start: int, shift: int, *, moved: bool = True) -> float:
        rows = np.arange(n)
        source = rows + np.where(rows >= start, shift, 0)
        # rows without joints, and those whose joints an earlier one has, are left out
        good = np.flatnonzero((source >= 0) & (source < n) & ((rows < start) | (source >= start)))
        good = good[thinned(len(good), _SEARCHED)]
        return float(np.mean(held_out(q[source[good] if moved else good], x[good])))

    # rows that predict each other well need no search
    if n < 12 + 2 * most or error(n, 0) < 0.02 * float(np.linalg.norm(x.std(axis=0))):
        return 0, 0, np.nan, np.nan
    step = max(1, n // 10)
    shifts = [shift for shift in range(-most, most + 1) if shift]
    tried = {(start, s): error(start, s) for start in range(0, n - 3, step) for s in shifts}
    for start, s in sorted(tried, key=lambda case: tried[case])[:4]:
        near = range(max(start - step + 1, 0), min(start + step, n - 3))
        tried |= {(k, s): error(k, s) for k in near}
    start, shift = min(tried, key=lambda case: tried[case])
    # of the same rows: one wrong row at the end is not mended by leaving it out
    other, own = tried[start, shift], error(start, shift, moved=False)
    return (start, shift, own, other) if other < 0.4 * own else (0, 0, own, other)


def unrelated(q: Array, x: Array) -> bool:
    """Whether joints predict what was seen no better than those of other rows would.

    Less than ten rows for each joint may be too few to tell.  From there on six joints at 60
    random postures miss by 0.8 of what the joints of other rows do, the worst of 45 such arms.
    """
    some = thinned(len(q), MOST)
    q, x = q[some], x[some]
    if len(q) < 10 * q.shape[1]:
        return False
    own, other = (held_out(joints, x).mean() for joints in (q, np.roll(q, len(q) // 2, axis=0)))
    return bool(own > 0.9 * other)
