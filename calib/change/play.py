"""Play: whether a joint of a log has more of it than the model knows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import spread_rows
from .rows import LogRows
from .significance import FreeNoise, GroupTest
from .system import System


@dataclass(frozen=True)
class PlaySettings:
    """When a joint has play."""

    # Of the play that a model knows, by which that may be wrong: 20 mrad were learned as 19.1
    play_share: float = 0.1
    # of a joint's rows that come from either side, or nothing tells its play
    least_share: float = 0.1
    # of the squared residuals: what explains less does not pay in `calib.body.approach` either
    least_explained: float = 0.06


PLAY = PlaySettings()


@dataclass(frozen=True)
class Play:
    """A joint that has more play than the model knows."""

    joint: int
    half: Array  # (dof,), half of its play, the other joints' zero [rad or m]
    deviation: float  # standard deviation of that
    score: float  # above 1 it is no chance, nor an error of what the model knows of it


def find_play(noise: FreeNoise, rows: LogRows) -> Play | None:
    """Find the joint whose play explains most beside all that may have changed; None for chance.

    A joint stands by half its play from where it stands coming from the other side: one more
    column a joint, x = -slope * side, and half = x' C^-1 y / x' C^-1 x.  The model learned its own
    from rows, too, with an error that the number of these tells.
    """
    system = noise.system
    side = rows.side[spread_rows(len(rows), len(system.observations.q))]
    columns = system.whiten(-system.slope * side[:, None])
    products = noise.nuisance.products(system.y, columns)
    matrix, vector = products.information(noise.size)
    precision = np.maximum(np.diag(matrix), 1e-300)
    half = vector / precision

    # the share of the squared residuals that each joint explains
    moved = noise.nuisance.rest(columns, noise.size)
    by_row = np.einsum("nmd,nm->nd", moved, noise.rest)
    square = by_row.sum(axis=0) ** 2
    squared_residual = (noise.rest**2).sum()
    squared_moves = (moved**2).sum(axis=(0, 1))
    explained = square / np.maximum(squared_residual * squared_moves, 1e-300)

    # an encoder that is noisy moves the tip along the same slope, to either side
    variance_of_rows = len(by_row) * by_row.var(axis=0)
    by_chance = square / (variance_of_rows + 1e-300)
    statistic = half * vector / noise.temper
    statistic = np.minimum(statistic, by_chance)
    statistic /= 1.0 + _rows_beside_training(system)
    may_play = _from_both_sides(side)
    may_play &= half > 0.0
    may_play &= explained > PLAY.least_explained
    statistic[~may_play] = 0.0

    joint = int(np.argmax(statistic))
    tests = noise.tests(products, side.shape[1])
    test = GroupTest("backlash", tests.chance(float(statistic[joint]), 1.0))
    if test.score <= 1.0:
        return None
    play = np.zeros_like(half)
    play[joint] = half[joint]
    approach = rows.model.approach
    learned = 0.0 if approach is None else approach.play[joint]
    is_error = play[joint] <= PLAY.play_share * learned
    return Play(
        joint=joint,
        half=play,
        deviation=math.sqrt(noise.temper / float(precision[joint])),
        score=0.0 if is_error else test.score,
    )


def _from_both_sides(side: Array) -> Mask:
    """Whether enough rows come from either side of each joint, (dof,), of sides (n, dof)."""
    above = (side > 0).mean(axis=0)
    below = (side < 0).mean(axis=0)
    smaller_share = np.minimum(above, below)
    return np.asarray(smaller_share > PLAY.least_share)


def _rows_beside_training(system: System) -> float:
    """Rows of the log for each one that the model learned from; 0 where it was simulated."""
    body = system.reference.body
    if body.simulated or not body.rows:
        return 0.0
    return len(system.observations.q) / body.rows
