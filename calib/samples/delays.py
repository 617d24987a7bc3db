"""Delays: a sensor's clock that is late or early against the joints', estimated from the rows.

Where positions are late by d, a row shows the tip where its joints were d before: what predicts it
misses by -J qdot d.  That regression, less what the predictor's own parameters could make of it, is
the estimate; its interval is a sandwich over blocks of neighbouring rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Mask
from ..errors import LogError
from .diagnosis import is_path
from .samples import Samples
from .settings import CLOCK


@dataclass(frozen=True)
class Delay:
    """By how much positions are later than the joints of their rows."""

    value: float  # [unit]
    sd: float  # its standard deviation [unit]
    unit: str  # "s" by the log's column of time, else "rows"
    share: float  # of the residual's weighted squares that it explains alone

    @property
    def clear(self) -> bool:
        """Whether it is sure, and matters."""
        return self._beyond(CLOCK.clear, CLOCK.share)

    def _beyond(self, deviations: float, share: float) -> bool:
        return abs(self.value) > deviations * self.sd and self.share > share

    def note(self) -> str:
        """What the user should be told, empty for nothing."""
        factor, unit = (1e3, "ms") if self.unit == "s" else (1.0, "rows")
        side = "late" if self.value > 0 else "early"
        sd = 1.96 * factor * self.sd
        words = f"{factor * abs(self.value):.3g} +- {sd:.2g} {unit} {side} against the joints"
        if self.clear:
            return f"the positions are {words}: corrected; poses at rest do not depend on clocks"
        if self._beyond(CLOCK.doubted, CLOCK.doubted_share):
            return (
                f"the positions may be {words}, which the rows do not settle: not corrected; "
                "measure at rest, or along a path that is run in both directions"
            )
        return ""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The joints of a log as a motion: rows in the order of time, in runs without a pause."""

    time: Array  # (n,) [unit]
    q: Array  # (n, dof) [rad or m]
    unit: str  # "s" or "rows"

    @staticmethod
    def of(samples: Samples) -> Trajectory | None:
        """The motion of a log's rows; None where they are poses, or known to be in time."""
        if samples.in_time or len(samples) < CLOCK.fewest_rows:
            return None
        if samples.time is not None:
            motion = Trajectory(samples.time, samples.q, "s")
        else:
            rows = (
                np.arange(len(samples))
                if samples.rows is None
                else samples.rows
            )
            motion = Trajectory(rows.astype(float), samples.q, "rows")
        joined = motion.joined
        return (
            motion
            if joined.mean() >= 0.5 and is_path(samples.q, joined)
            else None
        )

    @property
    def step(self) -> float:
        """The usual time from row to row [unit]."""
        step = np.diff(self.time)
        return float(np.median(step[step > 0])) if (step > 0).any() else 0.0

    @property
    def joined(self) -> Mask:
        """Whether each row but the last goes on to the next one without a pause (n - 1,)."""
        step = np.diff(self.time)
        return np.asarray(
            (step > 0) & (step <= CLOCK.longest_pause * self.step)
        )

    def before(self, delay: float) -> tuple[Array, Array]:
        """Joints (n, dof) at the rows' times less `delay`, and their velocity [../unit].

        NaN where the log has none.
        """
        from scipy.interpolate import CubicHermiteSpline

        when = self.time - delay
        q = np.full(self.q.shape, np.nan)
        velocity = np.full(self.q.shape, np.nan)
        for run in np.split(
            np.arange(len(when)), np.flatnonzero(~self.joined) + 1
        ):
            if len(run) < 3:
                continue
            time = self.time[run]
            inside = run[(when[run] >= time[0]) & (when[run] <= time[-1])]
            slope = np.gradient(self.q[run], time, axis=0)
            path = CubicHermiteSpline(time, self.q[run], slope)
            q[inside] = path(when[inside])
            velocity[inside] = path(when[inside], 1)
        return q, velocity

    def moved(self, samples: Samples, delay: float) -> Samples:
        """The rows whose joints are known `delay` [unit] before, with these."""
        q, _ = self.before(delay)
        inside = np.asarray(np.isfinite(q).all(axis=1))
        return replace(samples.take(inside), q=q[inside])


def with_offset(samples: Samples, offset: float) -> Samples:
    """The log with `offset` [s] added to the times of its positions: joints of these times.

    Raises LogError if it has no times, or the joints none in common with the positions.
    """
    if samples.time is None:
        raise LogError(
            "`time_offset` needs the times of the rows: expected a column `time` [s]"
        )
    q = Trajectory(samples.time, samples.q, "s").before(-offset)[0]
    inside = np.asarray(np.isfinite(q).all(axis=1))
    if not inside.any():
        raise LogError(
            f"`time_offset={offset:g}`: no row's joints are known {offset:g} s later"
        )
    outside = int((~inside).sum())
    note = f"{offset:+g} s added to the positions' times; {outside} rows have no joints"
    moved = replace(samples.take(inside), q=q[inside], in_time=True)
    return replace(moved, notes=(*samples.notes, note))


def estimate_delay(
    residual: Array,
    velocity: Array,
    columns: Array | None = None,
    precision: ArrayLike = (),
    pull: ArrayLike = (),
    *,
    play: Array | None = None,
    unit: str = "s",
) -> tuple[Delay, Array] | None:
    """Estimate by how much positions are late from what a predictor leaves of them.

    The one estimator of clocks: of logs, videos and bags (:mod:`calib.recording.clocks`).  A
    predictor that is fitted to other rows gives both, what it misses and what it would miss of its
    own velocity, without columns.

    residual, velocity : (n, m), measured less predicted positions, and the velocity of the
        predicted ones, NaN where unknown [unit, unit/time]
    columns : (n, m, k), derivative by parameters that are fitted beside, such as a clock's rate
    precision, pull : (k,), their prior precision, and how far they are below their prior mean
    play : (n, m, j), what else could explain the residual: the better explanation counts
    Returns the delay and how the parameters change with it (k,), None where nothing moves.
    """
    rows = np.flatnonzero(
        np.isfinite(velocity).all(axis=1) & np.isfinite(residual).all(axis=1)
    )
    n = len(rows)
    m = residual.shape[1]
    late = -velocity[rows].reshape(-1, 1)
    if n < CLOCK.fewest_rows or not np.abs(late).max() > 0:
        return None
    size = np.linalg.norm(residual[rows], axis=1)
    noise = float(np.median(size)) / np.sqrt(m) + 1e-9 * float(
        np.abs(late).max()
    )
    weight = (
        (CLOCK.student + m) / (CLOCK.student + (size / noise) ** 2) / noise**2
    )
    beside = _Beside(
        np.empty((n * m, 0))
        if columns is None
        else columns[rows].reshape(n * m, -1),
        np.repeat(weight, m)[:, None],
        np.asarray(precision, float),
    )
    r = residual[rows].reshape(-1, 1)
    base = beside.taken(r) + beside.pulled(np.asarray(pull, float))
    left_over = r - beside.X @ base
    alone = late - beside.X @ beside.taken(late)
    information = float(np.sum(late * beside.W * alone))
    if not information > 0:
        return None
    value = float(np.sum(alone * beside.W * left_over)) / information
    score = alone * beside.W * (left_over - alone * value)
    blocks = np.array_split(score.reshape(n, m).sum(axis=1), CLOCK.blocks)
    sd = float(np.linalg.norm([block.sum() for block in blocks])) / information
    share = beside.share(late, left_over)
    if (
        play is not None
        and beside.share(play[rows].reshape(n * m, -1), left_over) >= share
    ):
        share = 0.0
    change = base - beside.taken(late) * value
    return Delay(value, sd, unit, share), change[:, 0]


class _Beside:
    """Parameters that are fitted beside a delay: weighted least squares with a prior."""

    def __init__(self, X: Array, W: Array, precision: Array) -> None:
        self.X = X  # (nm, k), derivative by them
        self.W = W  # (nm, 1), weights
        self.precision = precision  # (k,)
        self.normal = X.T @ (W * X) + np.diag(precision)

    def taken(self, A: Array) -> Array:
        """What the parameters take (k, j) of columns (nm, j)."""
        return np.asarray(np.linalg.solve(self.normal, self.X.T @ (self.W * A)))

    def pulled(self, pull: Array) -> Array:
        """What the prior adds (k, 1)."""
        return np.asarray(
            np.linalg.solve(self.normal, (self.precision * pull)[:, None])
        )

    def share(self, A: Array, left_over: Array) -> float:
        """Share of the weighted squares that columns (nm, j) explain beyond the parameters."""
        alone = A - self.X @ self.taken(A)
        gram = A.T @ (self.W * alone)
        b = alone.T @ (self.W * left_over)
        explained = np.sum(b * (np.linalg.pinv(gram, hermitian=True) @ b))
        return float(explained / np.sum(self.W * left_over**2))
