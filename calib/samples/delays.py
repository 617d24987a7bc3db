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
        sure = abs(self.value) > CLOCK.clear * self.sd
        return sure and self.share > CLOCK.share

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
        if samples.in_time or len(samples) < CLOCK.fewest_rows:
            return None
        motion = Trajectory(samples.rows.astype(float), samples.q, "rows")
        if samples.time is not None:
            motion = Trajectory(samples.time, samples.q, "s")
        mostly = motion.is_continued.mean() >= 0.5
        moves = mostly and is_path(samples.q, motion.is_continued)
        return motion if moves else None

    @property
    def is_continued(self) -> Mask:
        """Whether each row but the last goes on to the next one without a pause (n - 1,)."""
        step = np.diff(self.time)
        later = step > 0
        usual = np.median(step[later]) if later.any() else 0.0
        return later & (step <= CLOCK.longest_pause * usual)

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

    def samples_before(self, samples: Samples, delay: float) -> Samples:
        """The rows whose joints are known `delay` [unit] before, with these."""
        q, _ = self.before(delay)
        inside = finite_rows(q)
        return replace(samples.take(inside), q=q[inside])


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
    rows = np.flatnonzero(finite_rows(np.hstack([velocity, residual])))
    late = -velocity[rows].reshape(-1, 1)
    if len(rows) < CLOCK.fewest_rows or not np.abs(late).max() > 0:
        return None
    numbers = residual[rows].size
    regression = _Regression(
        residual[rows],
        _weights(residual[rows], 1e-9 * np.abs(late).max()),
        columns[rows].reshape(numbers, -1),
        np.sqrt(np.asarray(precision, dtype=float)),
        np.asarray(pull),
    )
    solution = regression.of(late)
    value = float(solution.values[0])
    gain = value**2 / solution.power
    share = float(gain / (solution.squares + gain))
    if play is not None:
        by_play = regression.of(play[rows].reshape(numbers, -1))
        if by_play.squares <= solution.squares:
            share = 0.0
    delay = Delay(
        value, solution.sd_of_first(*residual[rows].shape), unit, share
    )
    return delay, solution.values[1:]


def _weights(residual: Array, least: float) -> Array:
    """Roots (n * m,) [1 / unit] of the weights of residuals (n, m), robust by Student's t.

    least : what the noise is larger by than its median [unit]: residuals may be zero
    """
    outputs = residual.shape[1]
    size = row_lengths(residual)
    noise = float(np.median(size)) / np.sqrt(outputs) + least
    weight = (CLOCK.student + outputs) / (CLOCK.student + (size / noise) ** 2)
    return np.repeat(np.sqrt(weight) / noise, outputs)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Weighted least squares of a cause (j columns) and of k parameters beside it."""

    inverse: Array  # (j + k, n * m + k), pseudoinverse of the columns
    values: Array  # (j + k,)
    rest: Array  # (n * m + k,), what the columns do not explain, in noises

    @property
    def power(self) -> float:
        """Variance of the first value where the rows' noise is 1."""
        return float(self.inverse[0] @ self.inverse[0])

    @property
    def squares(self) -> float:
        """Sum of the squares of the rest."""
        return float(self.rest @ self.rest)

    def sd_of_first(self, n: int, m: int) -> float:
        """Standard deviation of the first value, of n rows of m outputs.

        The larger one of blocks of neighbouring rows (a sandwich) and of independent rows: beside
        smooth columns the blocks' sums are too small.
        """
        score = (self.inverse[0] * self.rest)[: n * m].reshape(n, m).sum(axis=1)
        blocks = np.array_split(score, CLOCK.blocks)
        sandwich = float(np.linalg.norm([block.sum() for block in blocks]))
        freedom = max(n * m - len(self.values), 1)
        white = float(np.sqrt(self.power * self.squares / freedom))
        return max(sandwich, white)


@dataclass(frozen=True, eq=False)
class _Regression:
    """Residuals to be explained by a cause and by parameters beside it."""

    residual: Array  # (n, m) [unit]
    root: Array  # (n * m,) [1 / unit], roots of the rows' weights
    beside: Array  # (n * m, k) [unit], columns of the parameters
    prior: Array  # (k,), roots of their prior precision
    pull: Array  # (k,), how far they are below their prior mean

    def of(self, cause: Array) -> _Solution:
        """The solution with a cause (n * m, j); the prior adds a row for each parameter."""
        rows = self.root[:, None]
        target = np.append(
            self.root * self.residual.ravel(), self.prior * self.pull
        )
        of_prior = np.zeros((len(self.prior), cause.shape[1]))
        features = np.block(
            [
                [rows * cause, rows * self.beside],
                [of_prior, np.diag(self.prior)],
            ]
        )
        scale = np.linalg.norm(features, axis=0) + 1e-300
        inverse = np.linalg.pinv(features / scale) / scale[:, None]
        values = inverse @ target
        return _Solution(inverse, values, target - features @ values)
