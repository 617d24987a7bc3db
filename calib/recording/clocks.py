"""A sensor's clock against the joints': offset and rate, or a refusal.

A correlation of speeds finds candidates, since an arm may repeat its motion.  From each,
Gauss-Newton steps move the clocks to where joints predict the track best.  The best fit is taken if
its rival is clearly worse.  See :mod:`calib.recording.track`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.rows import median_length, row_lengths, spread_rows
from ..errors import CalibError, LogError
from ..samples.motion import joints_at
from .track import (
    CLOCK,
    ChainPredictor,
    SmoothPredictor,
    TrackPredictor,
    TrackRows,
    jumps,
)

SURE = 1.5e-3
"""Largest standard deviation of the offset that is accepted [s]."""


class ClockError(LogError):
    """Clocks of a sensor and of joints that no offset, or more than one, brings together."""


@dataclass(frozen=True)
class Clocks:
    """Joints' time of the sensor's time `t`: `t + offset + rate (t - middle)`."""

    # joints' clock less the sensor's in the middle of the recording [s]
    offset: float
    rate: float = 0.0  # how much faster it runs
    middle: float = 0.0  # that middle, by the sensor's clock [s]
    # median distance of rows from their prediction [px or mm]
    error: float = np.inf
    # standard deviation of the joints' time, at the recording's ends [s]
    sd: float = np.inf

    def joints_time(self, time: Array) -> Array:
        """Return the joints' times of the sensor's times [s]."""
        return time + self.offset + self.rate * (time - self.middle)

    def is_peak_of(self, other: Clocks) -> bool:
        """Whether two offsets belong to one peak."""
        return abs(self.offset - other.offset) <= CLOCK.apart

    def refuse_unsure(self, rival: float, spread: float, unit: str) -> None:
        """Raise ClockError where these clocks do not fit clearly best.

        rival : error of the best fit at another peak;  spread : of the track [unit]
        """
        is_close = self.error < CLOCK.fits * spread
        is_clear = self.error < CLOCK.clearly * rival
        is_slow = abs(self.rate) <= CLOCK.fastest
        if is_close and is_clear and is_slow and self.sd < SURE:
            return
        raise ClockError(
            f"no offset between the clocks is sure: the best, {self.offset:.3f} s to "
            f"{1e3 * self.sd:.2g} ms with rates that differ by {100 * self.rate:.2g} %, "
            f"leaves {self.error:.3g} of {spread:.3g} {unit}, another leaves {rival:.3g}; "
            f"expected {1e3 * SURE:.2g} ms, {100 * CLOCK.fastest:.1f} %, a quarter, and "
            f"{CLOCK.clearly:g} of the other's: are these the joints of this recording, is the "
            "frame rate the true one, does the motion repeat itself? record half a minute of "
            "varied motion, or give `time_offset`"
        )

    def words(self) -> str:
        """One line for the user."""
        # encoders with coarse steps of .5 deg leave 1.3 to 4.1 ms where the sd is .6
        sd = 1e3 * max(self.sd, SURE)
        return (
            f"clocks: joints are {self.offset:+.4f} s from the camera, sure to {sd:.2g} ms, "
            f"rates differ by {100 * self.rate:+.3f} %; they predict the tag to {self.error:.2g} px"
        )


@dataclass(frozen=True, eq=False)
class _Pair:
    """The track of a sensor, and joints with times by another clock."""

    t: Array  # (n,), the sensor's times [s]
    x: Array  # (n, m), the track at them [px or mm]
    joint_time: Array  # (k,), the joints' times [s]
    q: Array  # (k, joints), at them [rad or m]

    def joints(self, when: Array) -> Array:
        """Joints (r, joints) at their clock's times (r,)."""
        return joints_at(when, self.joint_time, self.q)

    def peaks(self) -> list[float]:
        """The offsets of the highest peaks of the correlation of speeds [s]."""
        from scipy.ndimage import maximum_filter1d
        from scipy.signal import correlate, correlation_lags

        # speeds of track and joints on one grid of time
        step = 1.0 / CLOCK.grid
        track_grid = np.arange(self.t[0], self.t[-1], step)
        joint_grid = np.arange(self.joint_time[0], self.joint_time[-1], step)
        if min(len(track_grid), len(joint_grid)) < 2 * CLOCK.grid:
            return []
        track_speed = _speed(joints_at(track_grid, self.t, self.x))
        scales = np.maximum(self.q.std(0), 1e-9)
        joints_speed = _speed(self.joints(joint_grid) / scales)

        # their correlation at each lag at which most of the shorter one overlaps
        overlap = correlate(joints_speed**0, track_speed**0, method="fft")
        shorter = min(len(track_speed), len(joints_speed))
        is_long = overlap > int(CLOCK.overlap * shorter) - 0.5
        products = correlate(joints_speed, track_speed, method="fft")
        correlation = products[is_long] / np.sqrt(overlap[is_long])
        lags = correlation_lags(len(joints_speed), len(track_speed))[is_long]

        # peaks near a higher one are its shoulders
        width = 2 * CLOCK.shoulder + 1
        highest = maximum_filter1d(correlation, width, mode="nearest")
        peaks = np.flatnonzero(correlation >= highest)
        order = np.argsort(-correlation[peaks], kind="stable")
        best = peaks[order][: CLOCK.candidates]
        start = joint_grid[0] - track_grid[0]
        return [float(start + lags[peak] / CLOCK.grid) for peak in best]

    def sample(self, clocks: Clocks, count: int) -> TrackRows:
        """About `count` rows with joints."""
        times = clocks.joints_time(self.t)
        first, last = self.joint_time[[0, -1]]
        inside = np.flatnonzero((times >= first) & (times <= last))
        rows = inside[spread_rows(len(inside), count)]
        when = times[rows]
        return TrackRows(
            self.x[rows],
            self.joints(when),
            ahead=self.joints(when + CLOCK.step),
            behind=self.joints(when - CLOCK.step),
            time=when,
        )

    def refine(
        self, start: Clocks, revolute: tuple[bool, ...] | None
    ) -> Clocks | None:
        """Fit the offset, and the rate where rows show one; without `revolute` no planar chain."""
        rows = self.sample(start, CLOCK.long[0])
        try:
            model: TrackPredictor = SmoothPredictor()
            if revolute:
                model = ChainPredictor(rows.q, rows.track, revolute)
            in_step = self.fit(model, start, CLOCK.long)
            free = self.fit(model, in_step, CLOCK.long, rate=True)
        except (CalibError, np.linalg.LinAlgError):
            return None
        is_clear = free.error < CLOCK.shows_rate * in_step.error
        return free if is_clear else in_step

    def fit(
        self,
        model: TrackPredictor,
        start: Clocks,
        most: tuple[int, int],
        *,
        rate: bool = False,
    ) -> Clocks:
        """Move clocks to where rows are predicted best, by Gauss and Newton's method.

        most : rows and steps;  rate : whether the clocks' rate is free
        """
        count, steps = most
        clocks = start
        best = replace(start, error=np.inf)
        rate_sd = CLOCK.rate_sd if rate else 1e-12
        for _ in range(steps):
            # how late the track is, and how rate and chain change
            sample = self.sample(clocks, count)
            if len(sample.q) < CLOCK.least_rows:
                break
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                linear = model.linearise(sample)
                step = linear.delay(clocks.rate, rate_sd)
            if step is None or not np.isfinite(step[0].value):
                break
            late, change = step

            # the best clocks, until they settle
            error_before = clocks.error
            # three neighbouring rows count as one; at the ends of a line twice the sd
            sd = np.sqrt(3.0) * late.sd * (2.0 if rate else 1.0)
            error = median_length(linear.residual)
            clocks = replace(clocks, error=error, sd=sd)
            best = min(best, clocks, key=attrgetter("error"))
            moved = max(abs(late.value), abs(change[-1]) * np.ptp(self.t))
            change_of_error = abs(error - error_before)
            is_steady = change_of_error < CLOCK.settled_error * error
            if moved < CLOCK.settled and is_steady:
                break

            # a step, shortened where the velocity is a poor guide, not far from the start
            scale = min(1.0, CLOCK.farthest_step / max(abs(late.value), 1e-12))
            model.move(scale * change[:-1])
            later = clocks.offset - scale * late.value
            away = np.clip(
                later - start.offset, -CLOCK.farthest, CLOCK.farthest
            )
            clocks = replace(
                clocks,
                offset=start.offset + float(away),
                rate=clocks.rate + float(scale * change[-1]),
            )
        return best


def _speed(values: Array) -> Array:
    """Smooth speed (n,) of values (n, d) on the grid of time, less its mean."""
    velocity = np.gradient(values, 1.0 / CLOCK.grid, axis=0)
    speed = row_lengths(velocity)
    window = np.hanning(CLOCK.smooth)[1:-1]
    smooth: Array = np.convolve(speed, window / window.sum(), "same")
    smooth -= smooth.mean()
    return smooth


@one_blas_thread()
def align_clocks(
    time: Array,
    track: Array,
    joint_time: Array,
    q: Array,
    revolute: Sequence[bool] | None = None,
    unit: str = "px",
) -> Clocks:
    """Find when the joints were where a sensor saw the tip.

    time, track : (n,) [s], (n, m) [unit], times by the sensor's clock, and where the tip was, in
        pixels, or mm in space; NaN where it was not seen
    joint_time, q : (k,) [s], (k, joints) [rad or m], joints at increasing times by their clock
    revolute : which joints turn; all if not given
    Raises ClockError if nothing moves, no offset fits, or more than one does.
    """
    usable = np.isfinite(track[:, 0]) & ~jumps(track)
    pair = _Pair(time[usable], track[usable], joint_time, q)
    spread = float(np.sqrt(pair.x.var(axis=0).sum())) if usable.any() else 0.0
    is_moving = (
        spread >= CLOCK.least_spread
        and np.ptp(q, axis=0).max() >= CLOCK.least_motion
        and len(pair.t) >= CLOCK.least_frames
    )
    peaks = pair.peaks() if is_moving else []
    if not peaks:
        raise ClockError(
            f"the clocks cannot be matched: the tip is in {len(pair.t)} frames, its places spread "
            f"by {spread:.2g} {unit}, or the arm never moves; expected 5 s of motion or more, or "
            "`time_offset`"
        )

    middle = float(pair.t[[0, -1]].mean())
    starts = [Clocks(peak, middle=middle) for peak in peaks]
    short_fits = _by_error(
        pair.fit(SmoothPredictor(), start, CLOCK.short) for start in starts
    )
    # the best fit of each peak
    candidates = [
        fit
        for k, fit in enumerate(short_fits)
        if not any(fit.is_peak_of(better) for better in short_fits[:k])
    ]
    most = CLOCK.chain_fits * spread
    some = candidates[: CLOCK.long_fits]
    best, *others = _long_fits(pair, some, revolute, most) or short_fits

    rivals = [fit.error for fit in others if not fit.is_peak_of(best)]
    best.refuse_unsure(min(rivals, default=np.inf), spread, unit)
    return best


def _long_fits(
    pair: _Pair,
    candidates: Sequence[Clocks],
    revolute: Sequence[bool] | None,
    most: float,
) -> list[Clocks]:
    """Fits from candidates, the best first.

    A planar chain needs fewer rows, so it is tried first; of an arm in space no planar chain has a
    smaller error than `most` [px].
    """
    if pair.x.shape[1] == 2:
        kinds = tuple(revolute or [True] * pair.q.shape[1])
        chains = _by_error(pair.refine(start, kinds) for start in candidates)
        if chains and chains[0].error < most:
            return chains
    return _by_error(pair.refine(start, None) for start in candidates)


def _by_error(fits: Iterable[Clocks | None]) -> list[Clocks]:
    """The fits that succeeded, the best first."""
    clocks = [fit for fit in fits if fit is not None]
    return sorted(clocks, key=attrgetter("error"))
