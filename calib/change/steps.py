"""Steps: a change of the arm or the sensor within a log, from one row on.

A cause that sets in at row r has columns X that are zero before it.  Each cause is tested from each
of some rows on (`significance` has the same for a whole log)::

    g = y' C^-1 X (X' C^-1 X)^-1 X' C^-1 y,    g / y' C^-1 y ~ Beta(k / 2, (f - k) / 2)  by chance

with k directions of X, and f of the rows that show the noise.  C holds all that may have changed
before the log, and a smooth residual of all that the best explanation leaves: rows whose joints
were elsewhere, early and late, show no step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter, itemgetter
from typing import NamedTuple

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.parameters import Indices
from ..common.arrays import Array, Index
from ..common.rows import solve_least_squares, spread_rows
from .causes import CREEP_WAVES, single_causes
from .explanation import Explanation
from .noise import FALSE_ALARM, sd_of_changes
from .rows import LEAST_ROWS, OUTLIER, Observations
from .significance import neighbours_apart_in_time
from .system import SYSTEM, NoisyJoint, Nuisance, System


@dataclass(frozen=True)
class StepSettings:
    """Where steps are looked for."""

    # most rows from which on a cause is tested
    starts: int = 40
    # least share of the squared residuals that a step explains
    least_explained: float = 0.1
    # least share of neighbours on either side of a step, over that of rows in any order
    mixed: float = 0.5


STEPS = StepSettings()


class _Step(NamedTuple):
    """A cause from one row on."""

    share: float  # of y' C^-1 y that it explains
    start: int  # its first row
    indices: Indices  # (k,), parameters of the cause
    amplitudes: Array  # (k,), their changes


def find_step(
    explanation: Explanation,
    observations: Observations,
    u: Array,
    noisy: NoisyJoint | None,
) -> int | None:
    """The first of the rows after a change within a log, None where there may be none.

    explanation : the best of the whole log
    observations : all rows of the log, in the order of time
    u : (n, dof), their joints in the unit box
    noisy : a joint whose encoder is noisy: its few large rows are no step
    """
    rows = spread_rows(len(u), SYSTEM.rows)
    starts = _starts(u[rows])
    if not len(starts):
        return None
    reference = replace(explanation.reference, beta=explanation.beta)
    system = System(reference, observations.some(SYSTEM.rows), noisy)
    # rows that contradict all others count for little
    limit = OUTLIER * float(np.median(np.abs(system.y)))
    y = np.clip(system.y, -limit, limit)
    # nor is the play of joints, which moved another way before
    plays = system.play_columns()
    halves = solve_least_squares(plays, y[:, None])
    y -= (plays @ halves)[:, 0]
    nuisance, noise, freedom = _most_likely_nuisance(system, y)
    steps = _steps(nuisance, y, noise, starts)
    best = max(steps, key=attrgetter("share"))

    # rows that err together count once
    columns = _columns_from(system, best.start, best.indices)
    left_over = y - columns @ best.amplitudes
    time = autocorrelation_time(nuisance.rest(left_over, noise))
    chance = len(steps) * _chance(best, freedom / time)
    if chance > FALSE_ALARM or best.share < STEPS.least_explained:
        return None
    return int(rows[best.start])


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


def _most_likely_nuisance(
    system: System, y: Array
) -> tuple[Nuisance, float, float]:
    """Whatever else residuals (N,) may be, the size of the noise, and its degrees of freedom.

    The smooth residual is the usual one, or all.
    """
    reference = system.reference
    missed = np.sqrt((y**2).mean()) * reference.sizes
    fits = []
    for residual_sd in (None, missed):
        nuisance = Nuisance(
            system,
            CREEP_WAVES,
            change_sd=sd_of_changes(reference),
            residual_sd=residual_sd,
        )
        statistics = nuisance.statistics(y, system.x[:, :0])
        _, likelihood = statistics.noises()
        noise = statistics.most_likely_noise()
        freedom = statistics.noise_freedom(noise)
        fits.append((likelihood.max(), nuisance, noise, freedom))
    _, nuisance, noise, freedom = max(fits, key=itemgetter(0))
    return nuisance, noise, freedom


def _columns_from(system: System, start: int, indices: Indices) -> Array:
    """Columns (N, k) of parameters, zero before a row."""
    columns = system.x[:, indices].copy()
    outputs = system.observations.z.shape[1]
    columns[: start * outputs] = 0.0
    return columns


def _steps(
    nuisance: Nuisance, y: Array, noise: float, starts: Index
) -> list[_Step]:
    """Each cause from each of some rows on, fitted to residuals (N,)."""
    system = nuisance.system
    reference = system.reference
    causes = single_causes(reference.structure, waves=reference.waves)
    free = np.unique(np.concatenate([*causes.values()]))
    total = float(y @ nuisance.rest(y, noise).ravel()) / noise
    steps = []
    for start in starts.tolist():
        columns = _columns_from(system, start, free)
        statistics = nuisance.statistics(y, columns)
        matrix, vector = statistics.information(noise)
        for indices in causes.values():
            at = np.searchsorted(free, indices)
            block = matrix[np.ix_(at, at)]
            # directions that no row determines
            block[np.diag_indices(len(at))] += 1e-9 * np.trace(block) + 1e-300
            amplitudes = np.asarray(
                np.linalg.solve(block, vector[at]), dtype=float
            )
            share = float(amplitudes @ vector[at]) / total
            steps.append(_Step(share, start, indices, amplitudes))
    return steps


def _chance(step: _Step, freedom: float) -> float:
    """Chance (beta) that noise of so many degrees of freedom explains as large a share."""
    from scipy.special import betainc

    causes = len(step.indices)
    rest = max(freedom - causes, 1e-3)
    return float(betainc(rest / 2, causes / 2, 1.0 - min(step.share, 1.0)))
