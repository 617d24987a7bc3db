"""A sensor's clock against the joints': offset and rate, or a refusal.

A correlation of speeds names candidates, for an arm may repeat itself; the one from which joints
predict the track best is taken, if its rival is clearly worse.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.rows import spread_rows
from ..errors import CalibError, LogError
from ..samples.delays import estimate_delay
from ..samples.motion import joints_at
from .track import Judge, jumps


@dataclass(frozen=True)
class ClockSettings:
    """How clocks are compared."""

    # peaks of the correlation of speeds that are judged
    candidates: int = 15
    # of them that are fitted to the end
    fitted: int = 3
    # [1/s], at which speeds are compared
    grid: float = 50.0
    # of the shorter recording must have a counterpart
    overlap: float = 0.8
    # rows, and steps, that judge candidates
    judged: tuple[int, int] = (120, 4)
    # and that refine the best
    refined: tuple[int, int] = (300, 12)
    # over which a velocity is taken [s]
    step: float = 0.01
    # [s]: far from the solution the velocity is a poor guide
    farthest_step: float = 0.08
    # that a candidate moves from its peak [s]
    farthest: float = 0.15
    # how much rates of clocks differ
    rate_sd: float = 4e-3
    # share of the error that is left where the rows show a rate
    shows_rate: float = 0.9
    # a planar chain that leaves more of the track's spread is none
    chain_fits: float = 0.03
    # the best candidate's error must be less than this share of its rival's
    clearly: float = 0.6
    # and less than this share of the track's spread
    fits: float = 0.25
    # difference of the rates: beyond it the stated frame rate is not the true one
    fastest: float = 0.012
    # candidates further apart than this are rivals [s]
    apart: float = 0.3


CLOCK = ClockSettings()

SURE = 1.5e-3
"""The standard deviation of the offset that is accepted [s]."""


Linear = tuple[Array, Array, Array, Array, Array]
"""What `estimate_delay` takes: residuals, velocities, slopes, precision and pull of a prior."""


class ClockError(LogError):
    """Clocks of a sensor and of joints that no offset, or more than one, brings together."""


@dataclass(frozen=True)
class Clocks:
    """Joints' time of the sensor's time `t`: `t + offset + rate (t - middle)`."""

    offset: float  # joints' clock less the sensor's in the middle of the recording [s]
    rate: float = 0.0  # how much faster it runs
    middle: float = 0.0  # that middle, by the sensor's clock [s]
    error: float = (
        np.inf
    )  # median distance that rows are predicted to [px or mm]
    doubt: float = (
        np.inf
    )  # standard deviation of the joints' time, at the recording's ends [s]

    def joints_time(self, time: Array) -> Array:
        """Return the joints' times of the sensor's times [s]."""
        return np.asarray(time + self.offset + self.rate * (time - self.middle))

    def words(self) -> str:
        """Say it in a line."""
        # encoders of coarse steps, .5 deg, leave 1.3 to 4.1 ms where the sd is .6
        doubt = 1e3 * max(self.doubt, SURE)
        return (
            f"clocks: joints are {self.offset:+.4f} s from the camera, sure to {doubt:.2g} ms, "
            f"rates differ by {100 * self.rate:+.3f} %; they predict the tag to {self.error:.2g} px"
        )


class _Waves:
    """What joints predict without a chain: blocks of rows by the others'."""

    def look(
        self, q: Array, ahead: Array, behind: Array, track: Array, since: Array
    ) -> Linear:
        """What `estimate_delay` takes, with the clocks' rate last."""
        judge = Judge(q)
        none = np.empty(0)
        speed = (judge.predict(ahead, track) - judge.predict(behind, track)) / (
            2.0 * CLOCK.step
        )
        velocity, apart = (
            judge.miss(values) for values in (speed, speed * since)
        )
        return judge.miss(track), velocity, apart[:, :, None], none, none

    def take(self, change: Array) -> None:
        """Nothing to take: each look is a fit of its own."""


class _Chain:
    """A planar chain under a tilted camera, fitted with the clocks: for few rows."""

    def __init__(
        self, q: Array, track: Array, revolute: tuple[bool, ...]
    ) -> None:
        from ..body.planar import planar_structure
        from ..body.rows import Rows
        from ..body.starts import (
            best_start,
        )  # both bring SciPy's linear algebra

        names = tuple(f"q{k}" for k in range(q.shape[1]))
        template = planar_structure(
            track, names, revolute, None, "homography", "px", False
        )
        members = dict(template.members())["chain"]
        begin = best_start(template, Rows(q, track), members)
        self._structure = begin.structure
        self._beta = begin.beta.copy()
        self._prior = begin.structure.prior((*members, "lens"))
        self._active = np.flatnonzero(self._prior.sd > 0)

    def look(
        self, q: Array, ahead: Array, behind: Array, track: Array, since: Array
    ) -> Linear:
        """What `estimate_delay` takes, with the clocks' rate last."""
        structure = self._structure
        beta = self._beta
        speed = (ahead - behind) / (2.0 * CLOCK.step)
        predicted, columns = structure.linearise(q, beta, self._active)
        velocity = np.einsum("nmd,nd->nm", structure.slope(q, beta), speed)
        columns = np.concatenate(
            [columns, (velocity * since)[:, :, None]], axis=2
        )
        pull = (self._prior.mean - beta)[self._active]
        return (
            track - predicted,
            velocity,
            columns,
            self._prior.sd[self._active] ** -2.0,
            pull,
        )

    def take(self, change: Array) -> None:
        """Move the chain's parameters."""
        self._beta[self._active] += change


@dataclass(frozen=True, eq=False)
class _Pair:
    """A track (n, m) at times (n,), and joints (m, joints) at times (m,) of another clock."""

    t: Array
    x: Array
    joint_time: Array
    q: Array

    def joints(self, when: Array) -> Array:
        """Joints (k, joints) at their clock's times (k,)."""
        return joints_at(when, self.joint_time, self.q)

    def peaks(self) -> list[float]:
        """The offsets of the highest peaks of the correlation of speeds [s]."""
        from scipy.ndimage import maximum_filter1d
        from scipy.signal import correlate, correlation_lags

        sensor = np.arange(self.t[0], self.t[-1], 1.0 / CLOCK.grid)
        joints = np.arange(
            self.joint_time[0], self.joint_time[-1], 1.0 / CLOCK.grid
        )
        if min(len(sensor), len(joints)) < 2 * CLOCK.grid:
            return []
        a = _speed(joints_at(sensor, self.t, self.x))
        b = _speed(self.joints(joints) / np.maximum(self.q.std(0), 1e-9))
        a = a - a.mean()
        b = b - b.mean()
        count = correlate(b**0, a**0, method="fft")  # of what overlaps
        far = count > int(CLOCK.overlap * min(len(a), len(b))) - 0.5
        lags = correlation_lags(len(b), len(a))[far]
        c = correlate(b, a, method="fft")[far] / np.sqrt(count[far])
        # peaks within 0.2 s of a higher one are its shoulders
        top = np.flatnonzero(c >= maximum_filter1d(c, 21, mode="nearest"))
        top = top[np.argsort(-c[top], kind="stable")][: CLOCK.candidates]
        return [
            float(joints[0] - sensor[0] + lags[k] / CLOCK.grid) for k in top
        ]

    def some(self, clocks: Clocks, rows: int) -> tuple[Array, Array]:
        """Joints' times (n,) and the track (n, m) of some rows."""
        when = clocks.joints_time(self.t)
        inside = np.flatnonzero(
            (when >= self.joint_time[0]) & (when <= self.joint_time[-1])
        )
        some = inside[spread_rows(len(inside), rows)]
        return when[some], self.x[some]

    def refine(
        self, start: Clocks, revolute: tuple[bool, ...] | None
    ) -> Clocks | None:
        """Fit the offset, and the rate where rows show one; without `revolute` no planar chain."""
        when, track = self.some(start, CLOCK.refined[0])
        try:
            there = self.joints(when)
            model = _Chain(there, track, revolute) if revolute else _Waves()
            plain = self.fit(model, start, CLOCK.refined)
            free = self.fit(model, plain, CLOCK.refined, rate=True)
        except (CalibError, np.linalg.LinAlgError):
            return None
        return free if free.error < CLOCK.shows_rate * plain.error else plain

    def fit(
        self,
        model: _Waves | _Chain,
        start: Clocks,
        most: tuple[int, int],
        *,
        rate: bool = False,
    ) -> Clocks:
        """Move clocks to where rows are predicted best, by Gauss and Newton's method."""
        clocks = start
        best = replace(start, error=np.inf)
        prior = np.array([CLOCK.rate_sd if rate else 1e-12]) ** -2.0
        for _ in range(most[1]):
            when, track = self.some(clocks, most[0])
            if len(when) < 16:
                break
            there, ahead, behind = (
                self.joints(when + h) for h in (0.0, CLOCK.step, -CLOCK.step)
            )
            since = (when - when.mean())[:, None]
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                miss, velocity, columns, prior_precision, pull = model.look(
                    there, ahead, behind, track, since
                )
                precision = np.append(prior_precision, prior)
                pull = np.append(pull, -clocks.rate)
                answer = estimate_delay(
                    miss, velocity, columns, precision, pull
                )
            if answer is None or not np.isfinite(answer[0].value):
                break
            late, change = answer
            # three neighbouring rows say as much as one; at the ends of a line twice the sd
            doubt = np.sqrt(3.0) * late.sd * (2.0 if rate else 1.0)
            before = clocks.error
            clocks = replace(clocks, error=_median(miss), doubt=doubt)
            best = min(best, clocks, key=attrgetter("error"))
            moved = max(abs(late.value), abs(change[-1]) * np.ptp(self.t))
            if (
                moved < 4e-5
                and abs(clocks.error - before) < 1e-3 * clocks.error
            ):
                break
            scale = min(1.0, CLOCK.farthest_step / max(abs(late.value), 1e-12))
            model.take(scale * change[:-1])
            low = start.offset - CLOCK.farthest
            high = start.offset + CLOCK.farthest
            offset = float(
                np.clip(clocks.offset - scale * late.value, low, high)
            )
            clocks = replace(
                clocks,
                offset=offset,
                rate=clocks.rate + float(scale * change[-1]),
            )
        return best


def _speed(values: Array) -> Array:
    along = np.gradient(values, 1.0 / CLOCK.grid, axis=0)
    window = np.hanning(15)[1:-1]
    return np.convolve(
        np.linalg.norm(along, axis=1), window / window.sum(), "same"
    )


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
    joint_time, q : (m,) [s], (m, joints) [rad or m], joints at increasing times by their clock
    revolute : which joints turn; all if not given
    Raises ClockError if nothing moves, no offset fits, or more than one does.
    """
    there = np.isfinite(track[:, 0]) & ~jumps(track)
    pair = _Pair(time[there], track[there], joint_time, q)
    spread = float(np.sqrt(pair.x.var(axis=0).sum())) if there.any() else 0.0
    moves = spread >= 5.0 and np.ptp(q, axis=0).max() >= 0.02
    if len(pair.t) < 20 or not moves or not (peaks := pair.peaks()):
        raise ClockError(
            f"the clocks cannot be matched: the tip is in {len(pair.t)} frames, its places spread "
            f"by {spread:.2g} {unit}, or the arm never moves; expected 5 s of motion or more, or "
            "`time_offset`"
        )
    middle = float(pair.t[[0, -1]].mean())
    starts = (Clocks(peak, middle=middle) for peak in peaks)
    judged = _by_error(
        pair.fit(_Waves(), start, CLOCK.judged) for start in starts
    )
    apart = [
        c
        for k, c in enumerate(judged)
        if all(_are_apart(c, d) for d in judged[:k])
    ][: CLOCK.fitted]
    kinds = tuple(revolute) if revolute is not None else (True,) * q.shape[1]
    # a planar chain needs fewer rows, so it goes first; an arm in space has none that fits
    fitted = (
        _by_error(pair.refine(c, kinds) for c in apart)
        if track.shape[1] == 2
        else []
    )
    if not fitted or not fitted[0].error < CLOCK.chain_fits * spread:
        fitted = _by_error(pair.refine(c, None) for c in apart) or judged
    clocks = fitted[0]
    rival = min(
        (c.error for c in fitted[1:] if _are_apart(c, clocks)), default=np.inf
    )
    fits = (
        clocks.error < CLOCK.fits * spread
        and clocks.error < CLOCK.clearly * rival
    )
    if not (fits and abs(clocks.rate) <= CLOCK.fastest and clocks.doubt < SURE):
        raise ClockError(
            f"no offset between the clocks is sure: the best, {clocks.offset:.3f} s to "
            f"{1e3 * clocks.doubt:.2g} ms with rates that differ by {100 * clocks.rate:.2g} %, "
            f"leaves {clocks.error:.3g} of {spread:.3g} {unit}, another leaves {rival:.3g}; "
            f"expected {1e3 * SURE:.2g} ms, {100 * CLOCK.fastest:.1f} %, a quarter, and "
            f"{CLOCK.clearly:g} of "
            "the other's: are these the joints of this recording, is the frame rate the true one, "
            "does the motion repeat itself? record half a minute of varied motion, or give "
            "`time_offset`"
        )
    return clocks


def _median(miss: Array) -> float:
    return float(np.median(np.linalg.norm(miss, axis=1)))


def _by_error(fits: Iterable[Clocks | None]) -> list[Clocks]:
    return sorted((c for c in fits if c is not None), key=attrgetter("error"))


def _are_apart(one: Clocks, other: Clocks) -> bool:
    return abs(one.offset - other.offset) > CLOCK.apart
