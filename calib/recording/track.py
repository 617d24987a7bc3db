"""The tag's track: how well joints predict it, its jumps, and rows whose joints are a neighbour's.

Ridge regression on products of the joints' harmonics, in which the tip of any arm is linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import spread_rows


@dataclass(frozen=True)
class TrackSettings:
    """How a track is judged."""

    # rows that a shift is judged by
    searched: int = 120
    # rows that are tried, and needed, for a shift
    farthest: int = 3
    fewest: int = 18
    # frames whose median says where the tip is
    window: int = 7
    # of neighbouring rows, held out in turn
    blocks: int = 8


TRACK = TrackSettings()

SOFT = 1e-4
"""Ridge, relative to the kernel's one."""


def _harmonics(q: Array, other: Array) -> Array:
    """Covariance (n, m) of harmonics up to the second of each joint, and of a free mean."""
    result = np.ones((len(q), len(other)))
    for a, b in zip(q.T, other.T, strict=True):
        first = np.cos(a[:, None] - b[None])
        second = 2.0 * first**2 - 1.0
        result *= 0.45 + 0.45 * first + 0.1 * second
    return result + 1.0


class Judge:
    """A fit of what was seen by joints, from which blocks of rows are held out.

    Joints `q` (n, joints) are in the order of time; neighbouring rows are left out together.
    """

    def __init__(self, q: Array) -> None:
        self.q = q
        ridge = SOFT * np.eye(len(q))
        self._inverse = np.linalg.inv(_harmonics(q, q) + ridge)

    def miss(self, x: Array) -> Array:
        """Return what the other blocks' fit leaves of values (n, d): linear in them."""
        weights = self._inverse @ (x - x.mean(0))
        miss: Array = np.empty_like(weights)
        count = min(TRACK.blocks, len(x))
        for block in np.array_split(np.arange(len(x)), count):
            inverse = self._inverse[np.ix_(block, block)]
            miss[block] = np.linalg.solve(inverse, weights[block])
        return miss

    def predict(self, q: Array, x: Array) -> Array:
        """Return what the fit to values (n, d) of all rows says at joints (m, joints)."""
        middle = x.mean(0)
        weights = self._inverse @ (x - middle)
        return np.asarray(_harmonics(q, self.q) @ weights + middle)


def row_shift(q: Array, x: Array) -> tuple[int, float, float]:
    """Find how many rows further down the joints are that fit better than a row's own, 0 for none.

    Then mean distances [unit of x] that blocks of rows are predicted to, as they are and shifted.
    """

    def error(shift: int) -> float:
        first = max(0, -shift)
        end = min(len(q), len(q) - shift)
        rows = np.arange(first, end)
        rows = rows[spread_rows(len(rows), TRACK.searched)]
        miss = Judge(q[rows + shift]).miss(x[rows])
        return float(np.linalg.norm(miss, axis=1).mean())

    if len(q) < TRACK.fewest:
        return 0, np.nan, np.nan
    shifts = range(-TRACK.farthest, TRACK.farthest + 1)
    errors = {shift: error(shift) for shift in shifts}
    best = min(errors, key=lambda shift: errors[shift])
    is_better = errors[best] < 0.4 * errors[0]
    return best if is_better else 0, errors[0], errors[best]


def jumps(x: Array) -> Mask:
    """Find frames away from the median of their neighbours (Hampel's filter).

    x (n, m) [px or mm] has NaN where nothing was seen; a mask (n,).
    """
    from scipy.ndimage import median_filter

    result = np.zeros(len(x), bool)
    visible = np.isfinite(x[:, 0])
    if visible.sum() < TRACK.window:
        return result
    places = x[visible]
    window = (TRACK.window, 1)
    away = places - median_filter(places, window, mode="nearest")
    usual = median_filter(np.abs(away), window, mode="nearest")
    scale = 1.48 * usual.max(axis=1)
    distances = np.linalg.norm(away, axis=1)
    result[visible] = distances > 6.0 * np.maximum(scale, 1.0)
    return result
