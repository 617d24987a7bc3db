"""The camera's clock against the joints': offset and rate, or a refusal.

A correlation of speeds alone is wrong by many seconds where an arm repeats itself. It only
names candidates. Each is judged by how well held-out blocks of joints predict the pixels; the best
must be clearly better than its rival.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.rows import thinned
from ..errors import CalibError, LogError
from ..samples.delays import estimate_delay
from ..samples.joint_values import joints_at
from .track import SOFT, Judge, jumps, softness

_CANDIDATES = 15  # peaks of the correlation of speeds that are judged
_GRID = 50.0  # [1/s]
_OVERLAP = 0.8  # of the shorter recording must have a counterpart
_ROWS = (120, 300, 160)  # that judge candidates, refine the best, and fit a chain
_STEP = 0.01  # over which the fit's velocity is taken [s]
_FARTHEST = 0.15  # that a candidate moves from its peak [s]
SURE = 1.5e-3
"""The standard deviation of the offset that is accepted [s]."""

_CHAINS = 3  # candidates to which a chain is fitted
_CHAIN_STEPS, _FARTHEST_STEP = 12, 0.08  # [s]: far from the solution the velocity is a poor guide
_RATE_SD = 4e-3  # how much rates of clocks differ
_SHOWS_RATE = 0.9  # share of the error that is left where the rows show a rate
_CHAIN_FITS = 0.03  # a planar chain that leaves more of the track's spread is none
_CLEARLY = 0.6  # the best candidate's error must be less than this share of its rival's
_FITS = 0.25  # and less than this share of the track's spread
_FASTEST = 0.012  # difference of the rates: beyond it the stated frame rate is not the true one
_PICTURE = 200.0  # standard deviation of a track that fills a picture [px]
_APART = 0.3  # candidates further apart than this are rivals [s]


@dataclass(frozen=True)
class Clocks:
    """Joints' time of camera time `t`: `t + offset + rate (t - middle)`."""

    offset: float  # joints' clock less the camera's in the middle of the recording [s]
    rate: float = 0.0  # how much faster it runs
    middle: float = 0.0  # that middle, by the camera's clock [s]
    error: float = np.nan  # median distance that held-out blocks are predicted to [unit]
    rival: float = np.inf  # and with the best other offset
    unit: str = "px"
    doubt: float = np.nan  # standard deviation of the joints' time, at the recording's ends [s]

    def joints_time(self, time: Array) -> Array:
        """Return the joints' times of camera times [s]."""
        return np.asarray(time + self.offset + self.rate * (time - self.middle))

    def words(self) -> str:
        """Say it in a line."""
        rate = f", rates differ by {100 * self.rate:+.3f} %" if abs(self.rate) > 5e-5 else ""
        return (
            f"clocks: joints are {self.offset:+.4f} s from the camera{rate}; they predict the tag "
            f"to {self.error:.2g} {self.unit}, with the next best offset to {self.rival:.2g} "
            f"{self.unit}"
        )


@dataclass(frozen=True, eq=False)
class ClockPair:
    """A track (n, 2) at times (n,), and joints (m, joints) at times (m,) of another clock."""

    t: Array
    x: Array
    joint_time: Array
    q: Array

    def joints(self, when: Array) -> Array:
        """Return joints (k, joints) at their clock's times (k,)."""
        return joints_at(when, self.joint_time, self.q)

    def peaks(self) -> list[float]:
        """Return the offsets of the highest peaks of the correlation of speeds [s]."""
        from scipy.ndimage import maximum_filter1d
        from scipy.signal import correlate, correlation_lags

        camera = np.arange(self.t[0], self.t[-1], 1.0 / _GRID)
        joints = np.arange(self.joint_time[0], self.joint_time[-1], 1.0 / _GRID)
        if min(len(camera), len(joints)) < 2 * _GRID:
            return []
        a = _speed(joints_at(camera, self.t, self.x))
        b = _speed(self.joints(joints) / np.maximum(self.q.std(0), 1e-9))
        a, b = a - a.mean(), b - b.mean()
        # the correlation coefficient of what overlaps, from sums over each overlap: those of
        # products with ones; the whole recordings' means and variances are not the overlap's
        parts = ((b, a), (b, a**0), (b**2, a**0), (b**0, a), (b**0, a**2), (b**0, a**0))
        ab, sb, sbb, sa, saa, count = (correlate(u, v, method="fft") for u, v in parts)
        far = count > int(_OVERLAP * min(len(a), len(b))) - 0.5
        lags, count = correlation_lags(len(b), len(a))[far], count[far]
        scale = (saa[far] - sa[far] ** 2 / count) * (sbb[far] - sb[far] ** 2 / count)
        c = (ab[far] - sa[far] * sb[far] / count) / np.sqrt(np.maximum(scale, 1e-12))
        # peaks within 0.2 s of a higher one are its shoulders
        top = np.flatnonzero(c >= maximum_filter1d(c, 21, mode="nearest"))
        top = top[np.argsort(-c[top], kind="stable")][:_CANDIDATES]
        return [float(joints[0] - camera[0] + lags[k] / _GRID) for k in top]

    def matched(self, clocks: Clocks, rows: int) -> tuple[Array, Array, Array]:
        """Return joints (n, joints), pixels (n, 2) and joints' times (n,) of some frames."""
        when = clocks.joints_time(self.t)
        inside = np.flatnonzero((when >= self.joint_time[0]) & (when <= self.joint_time[-1]))
        some = inside[thinned(len(inside), rows)] if len(inside) else inside
        return self.joints(when[some]), self.x[some], when[some]

    def candidate(self, peak: float) -> Clocks:
        """Move a peak to the offset near it that fits best, and judge it."""
        return self._fitted(Clocks(peak, 0.0, float(0.5 * (self.t[0] + self.t[-1]))), _ROWS[0], 4)

    def refined(self, start: Clocks) -> Clocks:
        """Fit the offset, and the rate where the rows show one."""
        there, seen, _ = self.matched(start, _ROWS[1])
        soft = softness(there, seen)
        plain, free = (self._fitted(start, _ROWS[1], 8, soft, rate=r) for r in (False, True))
        return _better(plain, free)

    def _fitted(
        self, start: Clocks, rows: int, steps: int, soft: float = SOFT, *, rate: bool = False
    ) -> Clocks:
        """Move clocks to where held-out blocks are predicted best, by Gauss and Newton's method."""
        clocks, best = start, replace(start, error=np.inf)
        for _ in range(steps):
            there, seen, when = self.matched(clocks, rows)
            if len(there) < 16:
                break
            judge = Judge(there, soft=soft)
            step, sd = self._step(judge, seen, when, rate=rate)
            doubt = float(np.hypot(sd[0], 0.5 * sd[1] * np.ptp(self.t)))  # at the track's ends
            clocks = replace(clocks, error=judge.error(seen), doubt=doubt)
            if abs(step[0]) < 2e-5 and abs(step[1]) * np.ptp(self.t) < 4e-5:
                return clocks
            best = min(best, clocks, key=attrgetter("error"))
            # the tip's velocity is a guide over a few hundredths of a second only
            offset = clocks.offset + float(np.clip(step[0], -0.06, 0.06))
            offset = float(np.clip(offset, start.offset - _FARTHEST, start.offset + _FARTHEST))
            clocks = replace(clocks, offset=offset, rate=clocks.rate + step[1])
        return best

    def chain(self, start: Clocks, revolute: tuple[bool, ...]) -> Clocks | None:
        """Fit a planar chain under a tilted camera, and the clocks with it; None where none fits.

        A chain has a dozen parameters, so ten postures say what three hundred must say to a fit
        without one: of half a minute of a planar arm 3 ms instead of 38.
        """
        from ..body.planar import planar_structure
        from ..body.starts import best_starts  # both bring SciPy's linear algebra

        q, seen, when = self.matched(start, _ROWS[2])
        if len(when) < 16:
            return None
        names = tuple(f"q{k}" for k in range(q.shape[1]))
        try:
            template = planar_structure(seen, names, revolute, None, "homography", "px", False)
            members = dict(template.members())["chain"]
            begin = best_starts(template, q, seen, members)[0]
            structure, prior = begin.structure, begin.structure.prior((*members, "lens"))
        except (CalibError, np.linalg.LinAlgError):
            return None
        active = np.flatnonzero(prior.sd > 0)
        since, beta = when - (start.middle + start.offset), begin.beta.copy()

        def fitted(clocks: Clocks, rate_sd: float) -> Clocks | None:
            precision = np.r_[prior.sd[active], rate_sd] ** -2.0
            for _ in range(_CHAIN_STEPS):
                at = when + clocks.offset - start.offset + clocks.rate * since
                q, ahead, behind = (self.joints(at + h) for h in (0.0, _STEP, -_STEP))
                speed = (ahead - behind) / (2.0 * _STEP)
                predicted, columns = structure.linearise(q, beta, active)
                velocity = np.einsum("nmd,nd->nm", structure.slope(q, beta), speed)
                apart = velocity * since[:, None]
                columns = np.concatenate([columns, apart[:, :, None]], axis=2)
                pull = np.r_[(prior.mean - beta)[active], -clocks.rate]
                miss = seen - predicted
                found = estimate_delay(miss, velocity, columns, precision, pull)
                if found is None or not np.isfinite(found[0].value):
                    return None
                late, change = found
                step = np.r_[change, -late.value]
                step *= min(1.0, _FARTHEST_STEP / max(abs(late.value), 1e-12))
                beta[active] += step[:-2]
                clocks = replace(
                    clocks, offset=clocks.offset + step[-1], rate=clocks.rate + step[-2],
                    error=float(np.median(np.linalg.norm(miss, axis=1))),
                    # three neighbouring rows say as much as one; at the ends of a line twice the sd
                    doubt=np.sqrt(3.0) * late.sd * (2.0 if rate_sd == _RATE_SD else 1.0),
                )  # fmt: skip
            return clocks

        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            plain = fitted(start, 1e-12)
            return None if plain is None else _better(plain, fitted(plain, _RATE_SD))

    def _step(self, judge: Judge, seen: Array, when: Array, *, rate: bool) -> tuple[Array, Array]:
        """Return the change of offset and rate that the held-out misses ask for, and their sd.

        Were the joints late by d, held-out blocks would miss by d times the tip's velocity, less
        what the fit would have made of that: the same linear map takes both.
        """
        ahead, behind = (judge.predict(self.joints(when + h), seen) for h in (_STEP, -_STEP))
        velocity = (ahead - behind) / (2.0 * _STEP)
        miss = judge.miss(seen).ravel()
        terms = [velocity, velocity * (when - when.mean())[:, None]][: 2 if rate else 1]
        A = np.stack([judge.miss(term).ravel() for term in terms], axis=1)
        weight: Array = np.ones(len(miss))
        for _ in range(4):
            B = A * weight[:, None]
            found = np.asarray(np.linalg.lstsq(B, miss * weight, rcond=None)[0], float)
            residual = np.abs(miss - A @ found)
            scale = 1.48 * float(np.median(residual)) + 1e-9
            weight = np.sqrt(np.minimum(1.0, 2.0 * scale / np.maximum(residual, 1e-12)))
        B = A * weight[:, None]
        # neighbouring rows err alike: about three of them say as much as one
        sd = np.sqrt(3.0 * scale**2 * np.diag(np.linalg.pinv(B.T @ B)))
        return np.r_[found, 0.0][:2], np.r_[sd, 0.0][:2]


def _better(plain: Clocks, free: Clocks | None) -> Clocks:
    """Clocks with a rate of their own where the rows show it: noise would spoil both ends."""
    return plain if free is None or free.error > _SHOWS_RATE * plain.error else free


def _speed(values: Array) -> Array:
    along = np.gradient(values, 1.0 / _GRID, axis=0)
    window = np.hanning(15)[1:-1]
    return np.convolve(np.linalg.norm(along, axis=1), window / window.sum(), "same")


class ClockError(LogError):
    """Clocks of a video and its joints that no offset, or more than one, brings together."""


@one_blas_thread()
def align_clocks(
    time: Array,
    seen: Array,
    joint_time: Array,
    q: Array,
    revolute: Sequence[bool] | None = None,
    unit: str = "px",
) -> Clocks:
    """Find when the joints were where a sensor saw the tip.

    time, seen : (n,) [s], (n, m) [unit], times by the sensor's clock, and where the tip was, in
        pixels or in space; NaN where it was not seen
    joint_time, q : (m,) [s], (m, joints) [rad or m], joints at increasing times by their clock
    revolute : which joints turn; all if not given
    Raises ClockError if nothing moves, no offset fits, or more than one does.
    """
    # pixels are what the limits below are in: others are scaled to a picture's size
    factor = 1.0 if unit == "px" else _PICTURE / max(float(np.nanmax(np.nanstd(seen, 0))), 1e-12)
    pixels = factor * seen
    there = np.isfinite(pixels[:, 0]) & ~jumps(pixels)
    t, x = time[there], pixels[there]
    pair = ClockPair(t, x, joint_time, q)
    if len(t) < 20 or not (peaks := pair.peaks()):
        raise ClockError(
            f"the recordings are too short to match the clocks: the tip is in {len(t)} frames, "
            "expected at least 5 s of motion"
        )
    spread = float(np.sqrt(((x - x.mean(0)) ** 2).sum(1).mean()))
    if spread < 5.0 or np.ptp(q, axis=0).max() < 0.02:
        raise ClockError("the arm never moves, so the clocks cannot be matched; give `time_offset`")
    judged = sorted(map(pair.candidate, peaks), key=attrgetter("error"))
    apart = [c for k, c in enumerate(judged) if all(_apart(c, d) for d in judged[:k])]
    kinds = tuple(revolute) if revolute is not None else (True,) * q.shape[1]
    planar = x.shape[1] == 2
    chains = [pair.chain(c, kinds) for c in apart[:_CHAINS]] if planar else []
    # a chain needs fewer rows, so it goes first; an arm in space has none that fits
    fitted = sorted((c for c in chains if c is not None), key=attrgetter("error"))
    if not fitted or not fitted[0].error < _CHAIN_FITS * spread:
        fitted = sorted(map(pair.refined, apart[:_CHAINS]), key=attrgetter("error"))
    clocks = fitted[0]
    rival = min((c.error for c in fitted[1:] if _apart(c, clocks)), default=np.inf)
    left, other, extent = (f"{v / factor:.3g} {unit}" for v in (clocks.error, rival, spread))
    if not clocks.error < _FITS * spread:
        raise ClockError(
            f"no offset between the clocks fits: the best leaves {left} of {extent}; are these the "
            "joints of this recording? else give `time_offset`"
        )
    if not clocks.error < _CLEARLY * rival:
        raise ClockError(
            f"the offset between the clocks is ambiguous: {clocks.offset:.2f} s leaves {left}, "
            f"another leaves {other}; record a motion that does not repeat itself, or give "
            "`time_offset`"
        )
    if abs(clocks.rate) > _FASTEST:
        raise ClockError(
            f"the clocks' rates differ by {100 * clocks.rate:.1f} %, at most "
            f"{100 * _FASTEST:.1f} % expected: is the frame rate the true one, are these the "
            "joints of this recording? else give `time_offset`"
        )
    if not clocks.doubt < SURE:
        raise ClockError(
            f"the offset between the clocks is {clocks.offset:.3f} s but sure to "
            f"{1e3 * clocks.doubt:.2g} ms only, {1e3 * SURE:.2g} ms expected: record half a minute "
            "or more with varied motion, or give `time_offset`"
        )
    return replace(clocks, error=clocks.error / factor, rival=float(rival) / factor, unit=unit)


def _apart(one: Clocks, other: Clocks) -> bool:
    return abs(one.offset - other.offset) > _APART
