"""The tag's track: how well joints predict it, its jumps, and rows whose joints are a neighbour's.

Ridge regression on the products of the joints' harmonics, in which the tip of any arm and,
closely, its pixels are linear. Blocks of neighbouring rows are held out, in closed form.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import thinned

_SEARCHED = 120  # rows that a shift is judged by
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


def row_shift(q: Array, x: Array, most: int = 3) -> tuple[int, float, float]:
    """Find how many rows further down the joints are that fit better than a row's own, 0 for none.

    Then mean distances [unit of x] that blocks of rows are predicted to, as they are and shifted.
    """

    def error(shift: int) -> float:
        rows = np.arange(max(0, -shift), min(len(q), len(q) - shift))
        rows = rows[thinned(len(rows), _SEARCHED)]
        return float(np.linalg.norm(Judge(q[rows + shift]).miss(x[rows]), axis=1).mean())

    if len(q) < 12 + 2 * most:
        return 0, np.nan, np.nan
    errors = {shift: error(shift) for shift in range(-most, most + 1)}
    best = min(errors, key=lambda shift: errors[shift])
    return best if errors[best] < 0.4 * errors[0] else 0, errors[0], errors[best]


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
