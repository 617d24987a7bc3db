"""Steps: changes within a log, which set in at a row r or grow along the log.

The columns X of a cause that sets in at r are zero before r.  Each cause is tested at several r::

    g = y' C^-1 X (X' C^-1 X)^-1 X' C^-1 y,    g / y' C^-1 y ~ Beta(k / 2, (f - k) / 2)  by chance

C includes all that may have changed before the log, and a smooth residual of all that is left:
where early and late rows have other joint values, they show no step.
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
    """Where steps are searched."""

    # most rows at which a cause may set in
    starts: int = 40
    # least share of the squared residuals that a step explains; it grows with the ratio of noise
    # variances of the shorter to the longer part.  20 times the noise in the last fifth of six
    # logs: a ratio of 3 to 18, shares of .07 to .18; steps: .6 to 3, and .12 to .82
    least_explained: float = 0.1
    # least share of neighbours that a step separates, over that of rows in random order
    mixed: float = 0.5


STEPS = StepSettings()


class Step(NamedTuple):
    """A change within a log."""

    row: int  # the first one after it, as the file counts
    is_gradual: bool  # whether it grew from the first row to the last


class _Course(NamedTuple):
    """A cause that sets in at a row, or grows from the first row to the last."""

    share: float  # share of y' C^-1 y that it explains
    start: int  # row at which it sets in; of a growing one the middle
    # (N, k), derivatives by its parameters, times the share of the change at each row
    columns: Array
    changes: Array  # (k,), of its parameters


def find_step(
    reference: Reference,
    observations: LogRows,
    noisy_joint: NoisyJoint | None,
) -> Step | None:
    """The change within a log, None where it may be chance.

    reference : with the parameters that explain the whole log best
    observations : all rows of the log, in the order of time
    noisy_joint : a joint whose encoder is noisy: its few large residuals are no step
    """
    rows = spread_rows(len(observations), SYSTEM.rows)
    starts = _starts(observations.u[rows])
    if not len(starts):
        return None
    system = System(reference, observations.at_most(SYSTEM.rows), noisy_joint)
    # rows that contradict all others are limited
    limit = OUTLIER * float(np.median(np.abs(system.y)))
    y = np.clip(system.y, -limit, limit)
    # residuals of exact rows are no noise
    if float((y**2).mean()) < SYSTEM.least_noise**2:
        return None
    y = _without_play(system, y)
    nuisance, statistics = _likelier_nuisance(system, y)
    noise = statistics.most_likely_noise()
    courses = list(_courses(nuisance, y, noise, starts))
    best = max(courses, key=attrgetter("share"))

    residual = y - best.columns @ best.changes
    # rows that err together count once
    freedom = statistics.noise_freedom(noise)
    freedom /= autocorrelation_time(nuisance.unexplained_part(residual, noise))
    chance = share_chance(best.share, len(best.changes), freedom)
    # a sensor that is noisier from a row on is no step
    outputs = observations.x.shape[1]
    parts = np.split(np.abs(residual), [best.start * outputs])
    shorter, longer = sorted(parts, key=len)
    noisier = float(np.median(shorter) / np.median(longer)) ** 2
    least_share = STEPS.least_explained * max(noisier, 1.0)
    if len(courses) * chance > FALSE_ALARM or best.share < least_share:
        return None
    row = int(observations.log.rows[rows[best.start]])
    return Step(row, is_gradual=bool(best.columns[0].any()))


def _starts(u: Array) -> Index:
    """Rows at which a change can set in: joints (n, dof) are alike before and after.

    On a path that never returns, a change in time cannot be told from one in place.
    """
    count = len(u) - 2 * LEAST_ROWS + 1
    if count < 1:
        return np.zeros(0, np.intp)
    first, second = neighbours_apart_in_time(u)
    starts: Index = LEAST_ROWS + spread_rows(count, STEPS.starts)
    is_before = first[:, None] < starts
    is_after = second[:, None] >= starts
    separated = (is_before & is_after).mean(axis=0)
    by_chance = 2.0 * starts * (len(u) - starts) / len(u) ** 2
    is_mixed = separated > STEPS.mixed * by_chance
    return np.asarray(starts[is_mixed])


def _without_play(system: System, y: Array) -> Array:
    """Residuals (N,) without what the play of joints explains, where these moved another way.

    The play is estimated beside all else that an arm may show: a least-squares fit of six plays
    alone to 300 residuals of 20 times the noise would remove, and add elsewhere, 3 times the noise.
    """
    nuisance, statistics = _likelier_nuisance(system, y)
    noise = statistics.most_likely_noise()
    plays = system.play_columns()
    matrix, vector = nuisance.statistics(y, plays).information(noise)
    halves = solve_least_squares(matrix, vector[:, None])
    residual: Array = y - (plays @ halves)[:, 0]
    return residual


def _likelier_nuisance(system: System, y: Array) -> tuple[Nuisance, Statistics]:
    """The likelier nuisance: a smooth residual of the usual size, or one as large as y (N,)."""
    reference = system.reference
    rms = np.sqrt((y**2).mean()) * reference.expected_noise
    fits = []
    for residual_sd in (None, rms):
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
    """Each cause, growing and setting in at each start, fitted to residuals (N,)."""
    system = nuisance.system
    causes = system.single_causes()
    free = np.unique(np.concatenate([*causes.values()]))
    n, outputs = system.observations.x.shape
    total = float(y @ nuisance.unexplained_part(y, noise).ravel()) / noise
    row = np.arange(n)
    growing = (row + 1.0) / n
    shares_of_rows = [(n // 2, growing)]
    shares_of_rows += [(start, row >= start) for start in starts.tolist()]
    for start, shares in shares_of_rows:
        columns = system.columns[:, free] * np.repeat(shares, outputs)[:, None]
        matrix, vector = nuisance.statistics(y, columns).information(noise)
        for indices in causes.values():
            among_free = np.searchsorted(free, indices)
            block = matrix[np.ix_(among_free, among_free)]
            # some directions no row determines
            regularisation = 1e-9 * np.trace(block) + 1e-300
            block[np.diag_indices(len(block))] += regularisation
            moments = vector[among_free]
            changes = np.asarray(np.linalg.solve(block, moments))
            share = float(changes @ moments) / total
            yield _Course(share, start, columns[:, among_free], changes)
