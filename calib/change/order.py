"""Order: what the order of a log's rows shows.

A joint with play is off towards the side from which it came (`find_play`), and a change within the
log sets in at row r, or grows along it (`find_step`): a cause then has columns X that are zero
before r.  Each cause is tested from each of some rows on (`significance` has the same for a whole
log)::

    g = y' C^-1 X (X' C^-1 X)^-1 X' C^-1 y,    g / y' C^-1 y ~ Beta(k / 2, (f - k) / 2)  by chance

with k directions of X, and f of the rows that show the noise.  C holds all that may have changed
before the log, and a smooth residual of all that is left: rows whose joints were elsewhere, early
and late, show no step.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from ..body.covariance import autocorrelation_time
from ..common.arrays import Array, Index
from ..common.rows import solve_least_squares, spread_rows
from .frame import Reference
from .noise import (
    FALSE_ALARM,
    NoiseFit,
    f_chance,
    score_of,
    sd_of_changes,
    share_chance,
)
from .rows import LEAST_ROWS, OUTLIER, LogRows
from .system import SYSTEM, NoisyJoint, Nuisance, System


@dataclass(frozen=True)
class Play:
    """A joint that has more play than the model knows."""

    joint: int
    half: float  # half of its play [rad or m]
    deviation: float  # standard deviation of that
    score: float  # above 1: it is no chance

    def taken_up(self, observations: LogRows) -> LogRows:
        """The observations at the joints' true values under this play."""
        q = observations.q.copy()
        q[:, self.joint] -= self.half * observations.side[:, self.joint]
        return replace(observations, q=q)


def find_play(noise: NoiseFit) -> Play | None:
    """Find the joint whose play explains most besides all that may have changed; None for chance.

    A joint is off by half its play, towards the side from which it came.  Each row has
    f and r, what K does not follow of -slope * side and of the residual::

        half = sum f r / sum f^2,    statistic = (sum f r)^2 / sum (f r - mean f r)^2

    noise : of the log, given all that may have changed
    """
    system = noise.system
    features = noise.nuisance.rest(system.play_columns(), noise.size)
    products = np.einsum("nmd,nm->nd", features, noise.residual)
    squares = np.maximum((features**2).sum(axis=(0, 1)), 1e-300)
    total = products.sum(axis=0)
    half = total / squares

    # an encoder that is noisy moves the tip along the same slope, to either side
    variance = len(products) * products.var(axis=0) + 1e-300
    statistic = total**2 / (variance * noise.correlation_time)
    # the model learned its own from rows, too, with an error that depends on their number
    body = system.reference.body
    if body.rows and not body.simulated:
        statistic /= 1.0 + len(products) / body.rows
    statistic[half <= 0.0] = 0.0
    joint = int(np.argmax(statistic))
    chance = len(half) * f_chance(float(statistic[joint]), 1.0, noise.freedom)
    score = score_of(chance)
    if score <= 1.0:
        return None
    return Play(
        joint=joint,
        half=float(half[joint]),
        deviation=math.sqrt(noise.correlation_time / float(squares[joint])),
        score=score,
    )


def follows_sides(residual: Array, side: Array) -> bool:
    """Whether residuals (n, m) differ, by no chance, with the side (n, dof) a joint came from.

    Along each axis the sum of side * residual is normal; of its square, over that of both::

        sum (side r)^2 / sum r^2 ~ chi-square (1)
    """
    from scipy.special import chdtrc

    products = np.einsum("nj,nm->njm", side, residual)
    variance = (products**2).sum(axis=0) + 1e-300
    statistic = products.sum(axis=0) ** 2 / variance
    chance = float(chdtrc(1, float(statistic.max())))
    return chance * float(statistic.size) < FALSE_ALARM


@dataclass(frozen=True)
class StepSettings:
    """Where steps are looked for."""

    # most rows from which on a cause is tested
    starts: int = 40
    # least share of the squared residuals that a step explains, times how much noisier the shorter
    # part is: 20 times the noise in the last fifth of six logs made that 3 to 18, with shares of
    # .07 to .18, and steps .6 to 3 with shares of .12 to .82
    least_explained: float = 0.1


STEPS = StepSettings()


class Step(NamedTuple):
    """A change within a log."""

    row: int  # the first one after it, as the file counts
    is_gradual: bool  # whether it went on from the first row to the last


class _Course(NamedTuple):
    """A cause that sets in at a row, or grows from the first row to the last."""

    share: float  # of y' C^-1 y that it explains
    start: int  # the row, the middle of one that grows
    # (N, k), of its parameters, times how much of it each row has
    columns: Array
    changes: Array  # (k,), of these


def find_step(
    reference: Reference,
    observations: LogRows,
    noisy: NoisyJoint | None,
) -> Step | None:
    """The change within a log, None where there may be none.

    reference : with the parameters that explain the whole log best
    observations : all rows of the log, in the order of time
    noisy : a joint whose encoder is noisy: its few large rows are no step
    """
    rows = spread_rows(len(observations), SYSTEM.rows)
    count = len(rows) - 2 * LEAST_ROWS + 1
    if count < 1:
        return None
    starts = LEAST_ROWS + spread_rows(count, STEPS.starts)
    system = System(reference, observations.some(SYSTEM.rows), noisy)
    # rows that contradict all others count for little
    limit = OUTLIER * float(np.median(np.abs(system.y)))
    y = np.clip(system.y, -limit, limit)
    # what exact rows leave over is no noise
    missed = math.sqrt(float((y**2).mean()))
    if missed < SYSTEM.least_noise:
        return None
    # beside all that may have changed before, all that is left may be smooth
    nuisance = Nuisance(
        system,
        change_sd=sd_of_changes(reference),
        residual_sd=missed * reference.sizes,
    )
    noise = nuisance.statistics(y).most_likely_noise()
    y = _without_play(nuisance, y, noise)
    statistics = nuisance.statistics(y)
    noise = statistics.most_likely_noise()
    courses = list(_courses(nuisance, y, noise, starts))
    best = max(courses, key=attrgetter("share"))

    left_over = y - best.columns @ best.changes
    # rows that err together count once
    freedom = statistics.noise_freedom(noise)
    freedom /= autocorrelation_time(nuisance.rest(left_over, noise))
    chance = share_chance(best.share, len(best.changes), freedom)
    # a sensor that is noisier from a row on is no step
    outputs = observations.x.shape[1]
    parts = np.split(np.abs(left_over), [best.start * outputs])
    shorter, longer = sorted(parts, key=len)
    noisier = float(np.median(shorter) / np.median(longer)) ** 2
    least_share = STEPS.least_explained * max(noisier, 1.0)
    if len(courses) * chance > FALSE_ALARM or best.share < least_share:
        return None
    row = int(observations.log.rows[rows[best.start]])
    return Step(row, is_gradual=bool(best.columns[0].any()))


def _without_play(nuisance: Nuisance, y: Array, noise: float) -> Array:
    """Residuals (N,) less what a play of joints explains, which moved another way before.

    Beside all else that an arm may show: of what is 20 times the noise and no play, a least-squares
    fit of six plays to 300 residuals alone would take, and leave elsewhere, 3 times the noise.
    """
    plays = nuisance.system.play_columns()
    matrix, vector = nuisance.statistics(y, plays).information(noise)
    halves = solve_least_squares(matrix, vector[:, None])
    rest: Array = y - (plays @ halves)[:, 0]
    return rest


def _courses(
    nuisance: Nuisance, y: Array, noise: float, starts: Index
) -> Iterator[_Course]:
    """Each cause along each course, fitted to residuals (N,)."""
    system = nuisance.system
    causes = system.single_causes()
    free = np.unique(np.concatenate([*causes.values()]))
    n, outputs = system.observations.x.shape
    total = float(y @ nuisance.rest(y, noise).ravel()) / noise
    row = np.arange(n)
    growing = (row + 1.0) / n
    courses = [(n // 2, growing)]
    courses += [(start, row >= start) for start in starts.tolist()]
    for start, course in courses:
        columns = system.x[:, free] * np.repeat(course, outputs)[:, None]
        matrix, vector = nuisance.statistics(y, columns).information(noise)
        for indices in causes.values():
            at = np.searchsorted(free, indices)
            # directions that no row determines
            block = matrix[np.ix_(at, at)]
            block[np.diag_indices(len(at))] += 1e-9 * np.trace(block) + 1e-300
            changes = np.asarray(np.linalg.solve(block, vector[at]))
            share = float(changes @ vector[at]) / total
            yield _Course(share, start, columns[:, at], changes)
