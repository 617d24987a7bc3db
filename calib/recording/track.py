"""A sensor's track: its jumps, and how joints predict it, by smooth functions or a planar chain.

The smooth functions are a ridge regression on products of the joints' harmonics, in which the tip
of any arm is linear.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import row_lengths, spread_rows
from ..samples.delays import Delay, estimate_delay


@dataclass(frozen=True)
class TrackSettings:
    """How a track is predicted, and which rows and frames contradict the prediction."""

    # most rows that are compared at a shift
    searched: int = 120
    # largest shift that is tried [rows]
    farthest: int = 3
    # rows that a recording needs for that
    fewest: int = 18
    # error at the best shift, over that without one, below which the rows are shifted
    better: float = 0.4
    # frames whose median is the tip's place
    window: int = 7
    # distance from that median beyond which a frame is a jump [sd of the distances]
    jump: float = 6.0
    # blocks of neighbouring rows, held out in turn
    blocks: int = 8
    # prior variance of a constant, of a first and of a second harmonic of each joint
    harmonics: tuple[float, float, float] = (0.45, 0.45, 0.1)
    # ridge, over the sum of these variances
    ridge: float = 1e-4


TRACK = TrackSettings()


def _harmonics(q: Array, other: Array) -> Array:
    """Covariance (n, m) of harmonics up to the second of each joint, and of a free mean."""
    covariance = np.ones((len(q), len(other)))
    by_constant, by_first, by_second = TRACK.harmonics
    for values, others in zip(q.T, other.T, strict=True):
        first = np.cos(values[:, None] - others)
        second = 2.0 * first**2 - 1.0
        covariance *= by_constant + by_first * first + by_second * second
    return covariance + 1.0


class RidgeFit:
    """A fit of values by joints, from which blocks of rows are held out.

    Joints `q` (n, joints) are in the order of time; neighbouring rows are held out together.
    """

    def __init__(self, q: Array) -> None:
        self.q = q
        covariance = _harmonics(q, q) + TRACK.ridge * np.eye(len(q))
        self._inverse = np.linalg.inv(covariance)

    def miss(self, x: Array) -> Array:
        """Held-out errors (n, d) of values (n, d), linear in them."""
        weights: Array = self._inverse @ (x - x.mean(axis=0))
        miss = np.empty_like(weights)
        count = min(TRACK.blocks, len(x))
        for block in np.array_split(np.arange(len(x)), count):
            inverse = self._inverse[np.ix_(block, block)]
            miss[block] = np.linalg.solve(inverse, weights[block])
        return miss

    def predict(self, q: Array, x: Array) -> Array:
        """Predictions (m, d) at joints (m, joints) of the fit to values (n, d) of all rows."""
        middle = x.mean(axis=0)
        weights = self._inverse @ (x - middle)
        return np.asarray(_harmonics(q, self.q) @ weights + middle)


def row_shift(q: Array, x: Array) -> tuple[int, float, float]:
    """Shift of the joints, in rows further down, that fits far better than no shift; else 0.

    q : (n, joints) [rad or m];  x : (n, d)
    Returns the mean held-out errors [unit of x] without a shift and with the best one, too.
    """

    def error(shift: int) -> float:
        first = max(0, -shift)
        end = min(len(q), len(q) - shift)
        rows = np.arange(first, end)
        rows = rows[spread_rows(len(rows), TRACK.searched)]
        miss = RidgeFit(q[rows + shift]).miss(x[rows])
        return float(row_lengths(miss).mean())

    if len(q) < TRACK.fewest:
        return 0, np.nan, np.nan
    shifts = range(-TRACK.farthest, TRACK.farthest + 1)
    errors = {shift: error(shift) for shift in shifts}
    best = min(errors, key=lambda shift: errors[shift])
    is_better = errors[best] < TRACK.better * errors[0]
    return best if is_better else 0, errors[0], errors[best]


def usable_rows(
    usable: Mask, doubts: Mapping[str, Mask]
) -> tuple[Mask, dict[str, int]]:
    """Usable rows (n,) without doubts, and how many rows each doubt removes."""
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
    # of normal noise the sd is 1.48 times the median of the absolute deviations
    sd = np.maximum(1.48 * usual.max(axis=1), 1.0)
    is_jump[is_visible] = row_lengths(away) > TRACK.jump * sd
    return is_jump


@dataclass(frozen=True)
class ClockSettings:
    """How clocks are compared."""

    # peaks of the correlation of speeds that get a short fit
    candidates: int = 15
    # the best of them, which get a long one
    long_fits: int = 3
    # rate at which speeds are compared [1/s]
    grid: float = 50.0
    # share of the shorter recording that must have a counterpart
    overlap: float = 0.8
    # rows and steps of a short fit
    short: tuple[int, int] = (120, 4)
    # rows and steps of a long one
    long: tuple[int, int] = (300, 12)
    # time to either side over which a velocity is taken [s]
    step: float = 0.01
    # largest step of the offset [s]: far from the solution the velocity is a poor guide
    farthest_step: float = 0.08
    # furthest that a candidate moves from its peak [s]
    farthest: float = 0.15
    # prior sd of how much the rates of clocks differ
    rate_sd: float = 4e-3
    # where the rows show a rate, less than this share of the error is left
    shows_rate: float = 0.9
    # a planar chain that leaves more of the track's spread is none
    chain_fits: float = 0.03
    # the best candidate's error must be less than this share of its rival's
    clearly: float = 0.6
    # the best candidate's error must be less than this share of the track's spread
    fits: float = 0.25
    # difference of the rates: beyond it the stated frame rate is not the true one
    fastest: float = 0.012
    # candidates further apart than this are rivals [s]
    apart: float = 0.3
    # time to either side of a peak in which lower ones are its shoulders [steps of the grid]
    shoulder: int = 10
    # length of the Hann window that smooths speeds [steps of the grid]
    smooth: int = 15
    # least spread of the track [unit], motion of a joint [rad or m] and frames
    least_spread: float = 5.0
    least_motion: float = 0.02
    least_frames: int = 20
    # rows below which a fit ends
    least_rows: int = 16
    # a fit has settled where clocks move less [s], and the error changes by a smaller share
    settled: float = 4e-5
    settled_error: float = 1e-3


CLOCK = ClockSettings()


class LinearTrack(NamedTuple):
    """A track linearised in the delay, the rate of the clocks and the predictor's k parameters."""

    residual: Array  # (n, m) [px or mm]
    velocity: Array  # (n, m), of the prediction [px/s or mm/s]
    columns: Array  # (n, m, k + 1), derivatives by the parameters and the rate
    # (k,), of the parameters' prior
    precision: Array = np.empty(0)
    # (k,), prior mean of the parameters less their values
    pull: Array = np.empty(0)

    def delay(self, rate: float, rate_sd: float) -> tuple[Delay, Array] | None:
        """How late the track is [s], and changes (k + 1,) of parameters and of the clocks' rate.

        None where the rows determine no delay.
        """
        precision = np.append(self.precision, rate_sd**-2.0)
        pull = np.append(self.pull, -rate)
        return estimate_delay(*self[:3], precision, pull)


@dataclass(frozen=True, eq=False)
class TrackRows:
    """Rows of a track, and the joints at their times by the present clocks."""

    track: Array  # (n, m) [px or mm]
    q: Array  # (n, joints) [rad or m]
    ahead: Array  # joints one `CLOCK.step` later
    behind: Array  # and one earlier
    time: Array  # (n,) [s]

    @property
    def since(self) -> Array:
        """Times since their mean (n, 1) [s]."""
        since: Array = self.time - self.time.mean()
        return since[:, None]

    @property
    def joint_speed(self) -> Array:
        """Speed of the joints (n, joints) [rad/s or m/s]."""
        return (self.ahead - self.behind) / (2.0 * CLOCK.step)


class TrackPredictor(Protocol):
    """A prediction of the track by joints."""

    def linearise(self, rows: TrackRows) -> LinearTrack:
        """The rows and their predictions, at the present parameters."""

    def move(self, change: Array) -> None:
        """Change the parameters by (k,)."""


class SmoothPredictor:
    """Prediction by smooth functions of the joints: each block of rows by a fit to the others."""

    def linearise(self, rows: TrackRows) -> LinearTrack:
        """The rows as the other blocks predict them."""
        fit = RidgeFit(rows.q)
        ahead = fit.predict(rows.ahead, rows.track)
        behind = fit.predict(rows.behind, rows.track)
        speed = (ahead - behind) / (2.0 * CLOCK.step)
        by_rate = fit.miss(speed * rows.since)[..., None]
        return LinearTrack(fit.miss(rows.track), fit.miss(speed), by_rate)

    def move(self, change: Array) -> None:
        """Do nothing: each linearisation is a fit of its own, without parameters."""


class ChainPredictor:
    """Prediction by a planar chain under a tilted camera, which is fitted with the clocks."""

    def __init__(
        self, q: Array, track: Array, revolute: tuple[bool, ...]
    ) -> None:
        from ..body.planar import planar_structure
        from ..body.rows import Rows
        from ..body.starts import best_start

        names = tuple(f"q{k}" for k in range(q.shape[1]))
        template = planar_structure(
            track, names, revolute, None, "homography", "px", False
        )
        chain = template.chain_blocks
        begin = best_start(template, Rows(q, track), chain)
        self._structure = begin.structure
        self._beta = begin.beta.copy()
        self._prior = begin.structure.prior((*chain, "lens"))
        self._active = np.flatnonzero(self._prior.sd > 0)

    def linearise(self, rows: TrackRows) -> LinearTrack:
        """The rows as the chain predicts them."""
        structure = self._structure
        beta = self._beta
        active = self._active
        predicted, by_beta = structure.linearise(rows.q, beta, active)
        by_joints = structure.slope(rows.q, beta)
        velocity = np.einsum("nmd,nd->nm", by_joints, rows.joint_speed)
        columns = np.dstack([by_beta, velocity * rows.since])
        precision = self._prior.sd[active] ** -2.0
        pull = (self._prior.mean - beta)[active]
        return LinearTrack(
            rows.track - predicted, velocity, columns, precision, pull
        )

    def move(self, change: Array) -> None:
        """Change the chain's parameters."""
        self._beta[self._active] += change
