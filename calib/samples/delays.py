"""Delays: a sensor's clock that is late or early against the joints', estimated from the rows.

Where positions are late by d, a row shows the tip where its joints were d before: what predicts it
misses by -J qdot d.  That regression, less what the predictor's own parameters could make of it, is
the estimate; its interval is the wider one of independent rows and of a sandwich over blocks of
neighbouring ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Mask
from ..common.rows import finite_rows, row_lengths
from ..errors import LogError
from .diagnosis import is_path
from .samples import Samples
from .settings import DELAY, ClearDelay


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
        limits = self._limits
        is_sure = limits.deviations * self.sd < abs(self.value)
        return is_sure and self.sd < limits.most and self.share > limits.share

    @property
    def doubt(self) -> float:
        """Standard deviation of clocks that are not corrected [unit], 0 out of the limits."""
        doubt = float(np.hypot(self.value, self.sd))
        limits = self._limits
        return doubt if limits.least < doubt < limits.most else 0.0

    @property
    def _limits(self) -> ClearDelay:
        return DELAY.in_rows if self.unit == "rows" else DELAY.timed

    def note(self) -> str:
        """One line for the user on a clear delay."""
        factor, unit = (1e3, "ms") if self.unit == "s" else (1.0, "rows")
        side = "late" if self.value > 0 else "early"
        size = f"{factor * abs(self.value):.3g} +- {1.96 * factor * self.sd:.2g} {unit}"
        return (
            f"the positions are {size} {side} against the joints: corrected; poses at rest do not "
            "depend on clocks"
        )


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The joints of a log as a motion: rows in the order of time, in runs without a pause."""

    time: Array  # (n,) [unit]
    q: Array  # (n, dof) [rad or m]
    unit: str  # "s" or "rows"

    @staticmethod
    def of(samples: Samples) -> Trajectory | None:
        """The motion of a log's rows; None where they are poses, or known to be in time."""
        if samples.in_time or len(samples) < DELAY.fewest_rows:
            return None
        motion = Trajectory(samples.rows.astype(float), samples.q, "rows")
        if samples.time is not None:
            motion = Trajectory(samples.time, samples.q, "s")
        mostly = motion.is_continued.mean() >= 0.5
        moves = mostly and is_path(samples.q, motion.is_continued)
        return motion if moves else None

    @property
    def is_continued(self) -> Mask:
        """Whether each row but the last leads to the next one without a pause (n - 1,)."""
        step = np.diff(self.time)
        later = step > 0
        usual = np.median(step[later]) if later.any() else 0.0
        return later & (step <= DELAY.longest_pause * usual)

    def before(self, delay: float) -> tuple[Array, Array]:
        """Joints (n, dof) at the rows' times less `delay`, and their velocity [../unit].

        NaN where the log has none.
        """
        from scipy.interpolate import CubicHermiteSpline

        when = self.time - delay
        q = np.full(self.q.shape, np.nan)
        velocity = np.full(self.q.shape, np.nan)
        ends = np.flatnonzero(~self.is_continued) + 1
        for run in np.split(np.arange(len(when)), ends):
            if len(run) < 3:
                continue
            time = self.time[run]
            inside = run[(when[run] >= time[0]) & (when[run] <= time[-1])]
            slope = np.gradient(self.q[run], time, axis=0)
            path = CubicHermiteSpline(time, self.q[run], slope)
            q[inside] = path(when[inside])
            velocity[inside] = path(when[inside], 1)
        return q, velocity

    def samples_before(
        self, samples: Samples, delay: float, sd: float = 0.0
    ) -> Samples:
        """The rows whose joints are known `delay` [unit] before, with these.

        sd : standard deviation of the delay [unit]
        """
        q, velocity = self.before(delay)
        inside = finite_rows(q)
        clock_sd = sd * velocity[inside] if sd else None
        return replace(samples.take(inside), q=q[inside], clock_sd=clock_sd)


def with_offset(samples: Samples, offset: float) -> Samples:
    """The log with `offset` [s] added to the times of its positions: joints of these times.

    Raises LogError if it has no times, or the joints none in common with the positions.
    """
    if samples.time is None:
        raise LogError(
            "`time_offset` needs the times of the rows: expected a column `time` [s]"
        )
    motion = Trajectory(samples.time, samples.q, "s")
    inside = finite_rows(motion.before(-offset)[0])
    if not inside.any():
        raise LogError(
            f"`time_offset={offset:g}`: no row's joints are known {offset:g} s later"
        )
    outside = int((~inside).sum())
    note = f"{offset:+g} s added to the positions' times; {outside} rows have no joints"
    moved = motion.samples_before(samples, -offset)
    return replace(moved, in_time=True, notes=(*samples.notes, note))


def estimate_delay(
    residual: Array,
    velocity: Array,
    columns: Array,
    precision: ArrayLike,
    pull: ArrayLike,
    *,
    play: Array | None = None,
) -> tuple[Delay, Array] | None:
    """Estimate by how much positions are late from what a predictor leaves of them.

    The one estimator of clocks: of logs, videos and bags (:mod:`calib.recording.clocks`).  A
    predictor that is fitted to other rows gives both, what it misses and what it would miss of its
    own velocity, without columns.

    residual, velocity : (n, m), measured less predicted positions, and the velocity of the
        predicted ones, NaN where unknown [unit, unit/time]
    columns : (n, m, k), derivative by parameters that are fitted as well, such as a clock's rate
    precision, pull : (k,), their prior precision, and how far they are below their prior mean
    play : (n, m, j), derivative by plays, which count where they explain clearly more
    Returns the delay and how the parameters change with it (k,), None where nothing moves.
    """
    rows = np.flatnonzero(finite_rows(np.hstack([velocity, residual])))
    late = -velocity[rows].reshape(-1, 1)
    if len(rows) < DELAY.fewest_rows or not np.abs(late).max() > 0:
        return None
    rest = residual[rows]
    weight = _weights(rest, 1e-9 * np.abs(late).max())
    root = np.sqrt(np.asarray(precision, float))
    # the prior adds a row for each parameter
    target = np.append(weight * rest.ravel(), root * pull)
    beside = np.vstack(
        [weight[:, None] * columns[rows].reshape(rest.size, -1), np.diag(root)]
    )

    cause = weight[:, None] * late
    inverse, values, remainder = _explain(target, cause, beside)
    squares = float(remainder @ remainder)
    if play is not None:
        plays = weight[:, None] * play[rows].reshape(rest.size, -1)
        with_play = _explain(target, np.hstack([cause, plays]), beside)
        squares_with_play = float(with_play[2] @ with_play[2]) + 1e-300
        # by the criterion of Schwarz (1978)
        gain = rest.size * np.log(squares / squares_with_play)
        if gain > plays.shape[1] * np.log(rest.size):
            inverse, values, remainder = with_play
            squares = squares_with_play
    variance = float(inverse[0] @ inverse[0])  # of noise of 1
    gain = float(values[0]) ** 2 / variance
    share = gain / (squares + gain)
    freedom = max(rest.size - len(values), 1)
    sd = _delay_sd(inverse[0], remainder, rest.shape, squares / freedom)
    changes = values[len(values) - columns.shape[2] :]
    return Delay(float(values[0]), sd, "s", share), changes


def _delay_sd(
    by_target: Array, remainder: Array, shape: tuple[int, ...], variance: float
) -> float:
    """Standard deviation of a delay, a sum of the rows' numbers and of the prior's.

    by_target, remainder : (n * m + k,), what each counts in the sum, and what the fit leaves of it
    shape : (n, m), of the rows
    variance : of a number where rows are independent
    """
    size = shape[0] * shape[1]
    by_rows = by_target[:size]
    scores = (by_rows * remainder[:size]).reshape(shape).sum(axis=1)
    # independent rows beside blocks of neighbouring ones (a sandwich): beside smooth columns the
    # blocks' sums are too small
    blocks = [block.sum() for block in np.array_split(scores, DELAY.blocks)]
    white = np.linalg.norm(by_rows) * np.sqrt(variance)
    noise = max(float(np.linalg.norm(blocks)), float(white))
    # exact rows do not settle all that the prior leaves: along one line a delay is an offset; and a
    # parameter that rows pull further from its prior than expected makes the delay as unsure
    pulled = np.maximum(1.0, np.abs(remainder[size:]))
    return float(np.hypot(noise, np.linalg.norm(by_target[size:] * pulled)))


def _explain(
    target: Array, cause: Array, beside: Array
) -> tuple[Array, Array, Array]:
    """Fit a target (r,) by a cause (n, j) of its first n rows, and by what is `beside` (r, k).

    Returns the pseudoinverse (j + k, r), the values (j + k,), and what they leave (r,).
    """
    below = np.zeros((len(target) - len(cause), cause.shape[1]))
    features = np.hstack([np.vstack([cause, below]), beside])
    scale = np.linalg.norm(features, axis=0) + 1e-300
    inverse = np.linalg.pinv(features / scale) / scale[:, None]
    values = inverse @ target
    return inverse, values, target - features @ values


def _weights(residual: Array, least: float) -> Array:
    """Roots (n * m,) [1 / unit] of the weights of residuals (n, m), robust by Student's t.

    least : what the noise is larger by than its median [unit]: residuals may be zero
    """
    outputs = residual.shape[1]
    size = row_lengths(residual)
    noise = float(np.median(size)) / np.sqrt(outputs) + least
    weight = (DELAY.student + outputs) / (DELAY.student + (size / noise) ** 2)
    return np.repeat(np.sqrt(weight) / noise, outputs)
