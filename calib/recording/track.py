"""The tag's track: how well joints predict it, its jumps, and rows whose joints are a neighbour's.

Ridge regression on products of the joints' harmonics, in which the tip of any arm is linear.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import row_lengths, spread_rows


@dataclass(frozen=True)
class TrackSettings:
    """How a track is judged."""

    # rows that judge a shift, at most
    searched: int = 120
    # largest shift that is tried [rows]
    farthest: int = 3
    # rows that a recording needs for that
    fewest: int = 18
    # frames whose median is the tip's place
    window: int = 7
    # blocks of neighbouring rows, held out in turn
    blocks: int = 8


TRACK = TrackSettings()

SOFT = 1e-4
"""Ridge, relative to the kernel's one."""


def _harmonics(q: Array, other: Array) -> Array:
    """Covariance (n, m) of harmonics up to the second of each joint, and of a free mean."""
    covariance = np.ones((len(q), len(other)))
    for values, others in zip(q.T, other.T, strict=True):
        first = np.cos(values[:, None] - others)
        second = 2.0 * first**2 - 1.0
        covariance *= 0.45 + 0.45 * first + 0.1 * second
    return covariance + 1.0


class Judge:
    """A fit of values by joints, from which blocks of rows are held out.

    Joints `q` (n, joints) are in the order of time; neighbouring rows are held out together.
    """

    def __init__(self, q: Array) -> None:
        self.q = q
        ridge = SOFT * np.eye(len(q))
        covariance = _harmonics(q, q) + ridge
        self._inverse = np.linalg.inv(covariance)

    def miss(self, x: Array) -> Array:
        """Held-out errors (n, d) of values (n, d), linear in them."""
        centred = x - x.mean(axis=0)
        weights: Array = self._inverse @ centred
        miss = np.empty_like(weights)
        rows = np.arange(len(x))
        count = min(TRACK.blocks, len(x))
        for block in np.array_split(rows, count):
            inverse = self._inverse[np.ix_(block, block)]
            miss[block] = np.linalg.solve(inverse, weights[block])
        return miss

    def predict(self, q: Array, x: Array) -> Array:
        """Predictions (m, d) at joints (m, joints) of the fit to values (n, d) of all rows."""
        middle = x.mean(axis=0)
        weights = self._inverse @ (x - middle)
        covariance = _harmonics(q, self.q)
        predicted: Array = covariance @ weights + middle
        return predicted


def row_shift(q: Array, x: Array) -> tuple[int, float, float]:
    """Shift of the joints, in rows further down, that fits far better than none does; else 0.

    q : (n, joints) [rad or m];  x : (n, d)
    Then mean held-out errors [unit of x] as the rows are, and with the best shift.
    """

    def error(shift: int) -> float:
        first = max(0, -shift)
        end = min(len(q), len(q) - shift)
        rows = np.arange(first, end)
        rows = rows[spread_rows(len(rows), TRACK.searched)]
        judge = Judge(q[rows + shift])
        miss = judge.miss(x[rows])
        distances = row_lengths(miss)
        return float(distances.mean())

    if len(q) < TRACK.fewest:
        return 0, np.nan, np.nan
    shifts = range(-TRACK.farthest, TRACK.farthest + 1)
    errors = {shift: error(shift) for shift in shifts}
    best = min(errors, key=lambda shift: errors[shift])
    is_better = errors[best] < 0.4 * errors[0]
    return best if is_better else 0, errors[0], errors[best]


def usable_rows(
    usable: Mask, doubts: Mapping[str, Mask]
) -> tuple[Mask, dict[str, int]]:
    """Usable rows (n,) that no doubt concerns, and how many each takes away."""
    dropped: dict[str, int] = {}
    for why, doubtful in doubts.items():
        dropped[why] = int(np.count_nonzero(usable & doubtful))
        usable = usable & ~doubtful
    return usable, dropped


def left_out_notes(what: str, dropped: Mapping[str, int]) -> tuple[str, ...]:
    """Notes of how many rows are left out, and why."""
    counts = dropped.items()
    return tuple(
        f"{count} {what} left out: {why}" for why, count in counts if count
    )


def jumps(x: Array) -> Mask:
    """Which frames (n,) are far from the median of their neighbours (Hampel's filter).

    x : (n, m) [px or mm], NaN where the tip is not in the picture
    """
    from scipy.ndimage import median_filter

    is_jump = np.zeros(len(x), bool)
    is_visible = np.isfinite(x[:, 0])
    if is_visible.sum() < TRACK.window:
        return is_jump
    places = x[is_visible]
    window = (TRACK.window, 1)
    away = places - median_filter(places, window, mode="nearest")
    usual = median_filter(np.abs(away), window, mode="nearest")
    sd = 1.48 * usual.max(axis=1)
    least = 6.0 * np.maximum(sd, 1.0)
    distances = row_lengths(away)
    is_jump[is_visible] = distances > least
    return is_jump
