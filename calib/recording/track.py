"""The tag's track: how well joints predict it, its jumps, and rows whose joints are a neighbour's.

Ridge regression on the products of the joints' harmonics, in which the tip of any arm and,
closely, its pixels are linear. Blocks of neighbouring rows are held out, in closed form.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import thinned

_SEARCHED = 120  # rows that each of some eighty shifts is judged by
SOFT = 1e-4
"""Ridge, relative to the kernel's one."""


def _harmonics(q: Array, other: Array) -> Array:
    """Covariance (n, m) of harmonics up to the second of each joint, and of a free mean."""
    result = np.ones((len(q), len(other)))
    for a, b in zip(q.T, other.T, strict=True):
        c = np.cos(a[:, None] - b[None])
        result *= 0.45 + 0.45 * c + 0.1 * (2.0 * c**2 - 1.0)
    return result + 1.0


class Judge:
    """A fit of what was seen by joints, from which blocks of rows are held out.

    Joints `q` (n, joints) are in the order of time; neighbouring rows are left out together,
    `blocks` times; `soft` is the ridge.
    """

    def __init__(self, q: Array, soft: float = SOFT, blocks: int = 8) -> None:
        n = len(q)
        self.q = q
        self._inverse = np.linalg.inv(_harmonics(q, q) + soft * np.eye(n))
        self._parts = [p for p in np.array_split(np.arange(n), min(blocks, n)) if len(p)]

    def miss(self, x: Array) -> Array:
        """Return what the other blocks' fit leaves of values (n, d): linear in them."""
        weights = self._inverse @ (x - x.mean(0))
        miss: Array = np.empty_like(weights)
        for part in self._parts:
            miss[part] = np.linalg.solve(self._inverse[np.ix_(part, part)], weights[part])
        return miss

    def predict(self, q: Array, x: Array) -> Array:
        """Return what the fit to values (n, d) of all rows says at joints (m, joints)."""
        middle = x.mean(0)
        return np.asarray(_harmonics(q, self.q) @ (self._inverse @ (x - middle)) + middle)


def row_shift(q: Array, x: Array, most: int = 3) -> tuple[int, int, float, float]:
    """Find a row from which on the joints of a neighbour row fit better than a row's own.

    A picture that is missing leaves the rows before it right, so that every row may be the first.

    Returns that row, and how many rows further down its joints are, 0 where rows fit as they are;
    then mean distances [unit of x] that blocks of rows are predicted to, as they are and shifted.
    """
    n = len(q)

    def error(start: int, shift: int, *, moved: bool = True) -> float:
        rows = np.arange(n)
        source = rows + np.where(rows >= start, shift, 0)
        # rows without joints, and those whose joints an earlier one has, are left out
        good = np.flatnonzero((source >= 0) & (source < n) & ((rows < start) | (source >= start)))
        good = good[thinned(len(good), _SEARCHED)]
        miss = Judge(q[source[good] if moved else good]).miss(x[good])
        return float(np.linalg.norm(miss, axis=1).mean())

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
    return start, shift if other < 0.4 * own else 0, own, other


def jumps(pixels: Array, half: int = 3) -> Mask:
    """Find frames away from the median of their neighbours (Hampel's filter).

    Pixels (n, 2), NaN where nothing was seen, with `half` neighbours on either side; a mask (n,).
    """
    seen = np.flatnonzero(np.isfinite(pixels[:, 0]))
    result = np.zeros(len(pixels), bool)
    if len(seen) < 2 * half + 1:
        return result
    x = np.pad(pixels[seen], ((half, half), (0, 0)), mode="edge")
    window = np.stack([x[k : k + len(seen)] for k in range(2 * half + 1)])
    middle = np.median(window, axis=0)
    far = np.linalg.norm(pixels[seen] - middle, axis=1)
    scale = 1.48 * np.median(np.abs(window - middle), axis=0).max(axis=1)
    result[seen] = far > 6.0 * np.maximum(scale, 1.0)
    return result
