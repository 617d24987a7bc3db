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
from . import settings
from .diagnosis import is_path
from .samples import Samples


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
        sure = abs(self.value) > settings.CLEAR_DELAY * self.sd
        return sure and self.share > settings.DELAY_SHARE

    def note(self) -> str:
        """What the user should be told, empty for nothing."""
        factor, unit = (1e3, "ms") if self.unit == "s" else (1.0, "rows")
        side = "late" if self.value > 0 else "early"
        sd = 1.96 * factor * self.sd
        words = f"{factor * abs(self.value):.3g} +- {sd:.2g} {unit} {side} against the joints"
        if self.clear:
            return f"the positions are {words}: corrected; poses at rest do not depend on clocks"
        if abs(self.value) > settings.DOUBTED_DELAY * self.sd and self.share > 0.02:
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
        if samples.in_time or len(samples) < 20:
            return None
        rows = np.arange(len(samples)) if samples.rows is None else samples.rows
        time, unit = (
            (rows.astype(float), "rows")
            if samples.time is None
            else (samples.time, "s")
        )
        motion = Trajectory(time, samples.q, unit)
        joined = motion.joined
        return motion if joined.mean() >= 0.5 and is_path(samples.q, joined) else None

    @property
    def step(self) -> float:
        """The usual time from row to row [unit]."""
        step = np.diff(self.time)
        return float(np.median(step[step > 0])) if (step > 0).any() else 0.0

    @property
    def joined(self) -> Mask:
        """Whether each row but the last goes on to the next one without a pause (n - 1,)."""
        step = np.diff(self.time)
        return np.asarray((step > 0) & (step <= settings.LONGEST_PAUSE * self.step))

    def before(self, delay: float) -> tuple[Array, Array]:
        """Joints (n, dof) at the rows' times less `delay`, and their velocity [../unit].

        NaN where the log has none.
        """
        from scipy.interpolate import CubicHermiteSpline

        when = self.time - delay
        result = np.full((2, *self.q.shape), np.nan)
        for rows in np.split(np.arange(len(when)), np.flatnonzero(~self.joined) + 1):
            t = self.time[rows]
            q = self.q[rows]
            inside = rows[(when[rows] >= t[0]) & (when[rows] <= t[-1])]
            if len(rows) > 2:
                path = CubicHermiteSpline(t, q, np.gradient(q, t, axis=0))
                result[:, inside] = path(when[inside]), path(when[inside], 1)
        return result[0], result[1]

    def moved(self, samples: Samples, delay: float) -> Samples:
        """The rows whose joints are known `delay` [unit] before, with these."""
        q, _ = self.before(delay)
        known = np.asarray(np.isfinite(q).all(axis=1))
        return replace(samples.take(known), q=q[known])


def with_offset(samples: Samples, offset: float) -> Samples:
    """The log with `offset` [s] added to the times of its positions: joints of these times.

    Raises LogError if it has no times, or the joints none in common with the positions.
    """
    if samples.time is None:
        raise LogError(
            "`time_offset` needs the times of the rows: expected a column `time` [s]"
        )
    q = Trajectory(samples.time, samples.q, "s").before(-offset)[0]
    known = np.asarray(np.isfinite(q).all(axis=1))
    if not known.any():
        raise LogError(
            f"`time_offset={offset:g}`: no row's joints are known {offset:g} s later"
        )
    told = f"{offset:+g} s added to the positions' times; {int((~known).sum())} rows have no joints"
    return replace(
        samples.take(known), q=q[known], in_time=True, notes=(*samples.notes, told)
    )


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
    r = residual[rows]
    late = -velocity[rows].reshape(-1, 1)
    if n < 20 or not np.abs(late).max() > 0:
        return None
    X = np.empty((n * m, 0)) if columns is None else columns[rows].reshape(n * m, -1)
    size = np.linalg.norm(r, axis=1)
    noise = float(np.median(size)) / np.sqrt(m) + 1e-9 * float(np.abs(late).max())
    weight = (
        (settings.DELAY_NU + m) / (settings.DELAY_NU + (size / noise) ** 2) / noise**2
    )
    W = np.repeat(weight, m)[:, None]
    prior = np.asarray(precision, float)
    normal = X.T @ (W * X) + np.diag(prior)

    def beside(A: Array) -> tuple[Array, Array]:
        """What the parameters take of columns, and what they cannot."""
        taken = np.linalg.solve(normal, X.T @ (W * A))
        return np.asarray(taken), np.asarray(A - X @ taken)

    base = beside(r.reshape(-1, 1))[0]
    base += np.linalg.solve(normal, (prior * np.asarray(pull, float))[:, None])
    left = r.reshape(-1, 1) - X @ base

    def share(A: Array) -> float:
        """Share of the weighted squares that columns explain beyond the parameters."""
        own = beside(A)[1]
        G = A.T @ (W * own)
        b = own.T @ (W * left)
        explained = np.sum(b * (np.linalg.pinv(G, hermitian=True) @ b))
        return float(explained / np.sum(W * left**2))

    taken, own = beside(late)
    information = float(np.sum(late * W * own))
    if not information > 0:
        return None
    value = float(np.sum(own * W * left)) / information
    rest = (own * W * (left - own * value)).reshape(n, m).sum(axis=1)
    blocks = np.array(
        [block.sum() for block in np.array_split(rest, settings.DELAY_BLOCKS)]
    )
    explained = share(late)
    if play is not None and share(play[rows].reshape(n * m, -1)) >= explained:
        explained = 0.0
    delay = Delay(value, float(np.linalg.norm(blocks)) / information, unit, explained)
    return delay, (base - taken * value)[:, 0]
