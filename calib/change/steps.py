"""Steps: changes that set in within a log, at row r, or grow along it.

A cause then has columns X that are zero before r.  Each cause is tested from each of some rows
on::

    g = y' C^-1 X (X' C^-1 X)^-1 X' C^-1 y,    g / y' C^-1 y ~ Beta(k / 2, (f - k) / 2)  by chance

C then holds all that may have changed before the log, and a smooth residual of all that is left:
rows whose joints were elsewhere, early and late, show no step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter, itemgetter
from typing import NamedTuple

import numpy as np

from ..body.covariance import autocorrelation_time
from ..common.arrays import Array, Index
from ..common.rows import solve_least_squares, spread_rows
from .frame import Reference
from .noise import FALSE_ALARM, sd_of_changes, share_chance
from .rows import LEAST_ROWS, OUTLIER, LogRows
from .significance import neighbours_apart_in_time
from .system import SYSTEM, NoisyJoint, Nuisance, Statistics, System


@dataclass(frozen=True)
class StepSettings:
    """Where steps are looked for."""

    # most rows from which on a cause is tested
    starts: int = 40
    # least share of the squared residuals that a step explains, times how much noisier the shorter
    # part is: 20 times the noise in the last fifth of six logs made that 3 to 18, with shares of
    # .07 to .18, and steps .6 to 3 with shares of .12 to .82
    least_explained: float = 0.1
    # least share of neighbours on either side of a step, over that of rows in any order
    mixed: float = 0.5


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
    starts = _starts(observations.u[rows])
    if not len(starts):
        return None
    system = System(reference, observations.some(SYSTEM.rows), noisy)
    # rows that contradict all others count for little
    limit = OUTLIER * float(np.median(np.abs(system.y)))
    y = np.clip(system.y, -limit, limit)
    # what exact rows leave over is no noise
    if float((y**2).mean()) < SYSTEM.least_noise**2:
        return None
    y = _without_play(system, y)
    nuisance, statistics = _likelier_nuisance(system, y)
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


def _starts(u: Array) -> Index:
    """Rows from which on a change can be found, where joints (n, dof) are alike before and after.

    Along a path without return a change of time is one of place.
    """
    count = len(u) - 2 * LEAST_ROWS + 1
    if count < 1:
        return np.zeros(0, np.intp)
    first, second = neighbours_apart_in_time(u)
    starts: Index = LEAST_ROWS + spread_rows(count, STEPS.starts)
    is_before = first[:, None] < starts
    is_after = second[:, None] >= starts
    apart = (is_before & is_after).mean(axis=0)
    by_chance = 2.0 * starts * (len(u) - starts) / len(u) ** 2
    is_mixed = apart > STEPS.mixed * by_chance
    return np.asarray(starts[is_mixed])


def _without_play(system: System, y: Array) -> Array:
    """Residuals (N,) less what a play of joints explains, which moved another way before.

    Beside all else that an arm may show: of what is 20 times the noise and no play, a least-squares
    fit of six plays to 300 residuals alone would take, and leave elsewhere, 3 times the noise.
    """
    nuisance, statistics = _likelier_nuisance(system, y)
    noise = statistics.most_likely_noise()
    plays = system.play_columns()
    matrix, vector = nuisance.statistics(y, plays).information(noise)
    halves = solve_least_squares(matrix, vector[:, None])
    rest: Array = y - (plays @ halves)[:, 0]
    return rest


def _likelier_nuisance(system: System, y: Array) -> tuple[Nuisance, Statistics]:
    """Whatever else residuals (N,) may be: of them the usual share is smooth, or all are."""
    reference = system.reference
    missed = np.sqrt((y**2).mean()) * reference.sizes
    fits = []
    for residual_sd in (None, missed):
        nuisance = Nuisance(
            system,
            change_sd=sd_of_changes(reference),
            residual_sd=residual_sd,
        )
        statistics = nuisance.statistics(y)
        _, likelihood = statistics.noises()
        fits.append((likelihood.max(), nuisance, statistics))
    _, nuisance, statistics = max(fits, key=itemgetter(0))
    return nuisance, statistics


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
