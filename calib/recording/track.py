"""The tag's track: how well joints predict it, its jumps, and rows whose joints are a neighbour's.

Ridge regression on products of the joints' harmonics, in which the tip of any arm is linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import thinned


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
        c = np.cos(a[:, None] - b[None])
        result *= 0.45 + 0.45 * c + 0.1 * (2.0 * c**2 - 1.0)
    return result + 1.0


class Judge:
    """A fit of what was seen by joints, from which blocks of rows are held out.

    Joints `q` (n, joints) are in the order of time; neighbouring rows are left out together.
    """

    def __init__(self, q: Array) -> None:
        self.q = q
        self._inverse = np.linalg.inv(_harmonics(q, q) + SOFT * np.eye(len(q)))

    def miss(self, x: Array) -> Array:
        """Return what the other blocks' fit leaves of values (n, d): linear in them."""
        weights = self._inverse @ (x - x.mean(0))
        miss: Array = np.empty_like(weights)
        for part in np.array_split(
            np.arange(len(x)), min(TRACK.blocks, len(x))
        ):
            miss[part] = np.linalg.solve(
                self._inverse[np.ix_(part, part)], weights[part]
            )
        return miss

    def predict(self, q: Array, x: Array) -> Array:
        """Return what the fit to values (n, d) of all rows says at joints (m, joints)."""
        middle = x.mean(0)
        return np.asarray(
            _harmonics(q, self.q) @ (self._inverse @ (x - middle)) + middle
        )


def row_shift(q: Array, x: Array) -> tuple[int, float, float]:
    """Find how many rows further down the joints are that fit better than a row's own, 0 for none.

    Then mean distances [unit of x] that blocks of rows are predicted to, as they are and shifted.
    """

    def error(shift: int) -> float:
        rows = np.arange(max(0, -shift), min(len(q), len(q) - shift))
        rows = rows[thinned(len(rows), TRACK.searched)]
        return float(
            np.linalg.norm(Judge(q[rows + shift]).miss(x[rows]), axis=1).mean()
        )

    if len(q) < TRACK.fewest:
        return 0, np.nan, np.nan
    errors = {
        shift: error(shift)
        for shift in range(-TRACK.farthest, TRACK.farthest + 1)
    }
    best = min(errors, key=lambda shift: errors[shift])
    return (
        best if errors[best] < 0.4 * errors[0] else 0,
        errors[0],
        errors[best],
    )


def jumps(x: Array) -> Mask:
    """Find frames away from the median of their neighbours (Hampel's filter).

    x (n, m) [px or mm] has NaN where nothing was seen; a mask (n,).
    """
    from scipy.ndimage import median_filter

    result = np.zeros(len(x), bool)
    visible = np.isfinite(x[:, 0])
    if visible.sum() >= TRACK.window:
        away = x[visible] - median_filter(
            x[visible], (TRACK.window, 1), mode="nearest"
        )
        scale = 1.48 * median_filter(
            np.abs(away), (TRACK.window, 1), mode="nearest"
        ).max(axis=1)
        result[visible] = np.linalg.norm(away, axis=1) > 6.0 * np.maximum(
            scale, 1.0
        )
    return result
