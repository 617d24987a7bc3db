"""Moved: whether the arm, its tool or the sensor moved while a log was taken."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from ..common.wording import for_people
from .samples import Samples
from .settings import STEP


class _Jump(NamedTuple):
    """A row from which on residuals are others at the same poses."""

    gain: float  # standard errors
    row: int
    size: float  # [unit]


def moved_words(samples: Samples, predicted: Array) -> list[str]:
    """One line on a log in which something moved; predicted (n, m) [unit] by a fit of all rows."""
    box = (samples.q - samples.lower) / (samples.upper - samples.lower)
    rows = thinned(len(samples), STEP.rows)
    residual = (samples.x - predicted)[rows]
    splits = (
        np.linspace(0, len(rows), STEP.parts + 1)[1:-1].astype(int).tolist()
    )
    jumps = [_jump(box[rows], residual, split) for split in splits]
    largest = max(filter(None, jumps), default=None)
    if largest is None:
        return []
    factor, unit = for_people(samples.unit)
    return [
        f"rows from about {rows[largest.row] + 1} on are {factor * largest.size:.2g} {unit} off "
        "earlier rows of the same poses: the arm, its tool or the sensor moved while the log was "
        "taken, or joints with play were approached from the other side; train from one part of "
        "the log"
    ]


def _jump(q: Array, residual: Array, split: int) -> _Jump | None:
    """The jump at a split of joints (n, dof) over their ranges and residuals (n, m), if any.

    A row is compared with its nearest neighbour before and after the split, and only where the one
    across is the nearer one: what is smooth along a path, but no arm, is no step in time.
    """
    from scipy.spatial import cKDTree  # takes .2 s

    if min(split, len(q) - split) < STEP.least:
        return None
    sides = (slice(split), slice(split, None))
    within = []
    across = []
    for side, other in (sides, sides[::-1]):
        near, neighbour = map(np.asarray, cKDTree(q[side]).query(q[side], 2))
        far, opposite = map(np.asarray, cKDTree(q[other]).query(q[side]))
        compared = far <= near[:, 1]
        here = residual[side]
        beside = here[neighbour[:, 1]]
        there = residual[other][opposite]
        within.append(((here - beside)[compared] ** 2).sum(axis=1))
        across.append(((here - there)[compared] ** 2).sum(axis=1))
    count = sum(map(len, across))
    if (
        min(map(len, within)) < STEP.least // 2
        or not np.concatenate(within).any()
    ):
        return None
    # a few wild rows are no step: medians; the noise of each side is half of what lies across
    usual = float(np.mean([np.median(squares) for squares in within]))
    squares = float(np.median(np.concatenate(across)))
    error = 2.0 / np.sqrt(residual.shape[1] * count)
    ratio = max(squares, 1e-300) / max(
        usual, 1e-300
    )  # exact rows leave nothing
    gain = float(np.log(ratio) / error)
    if squares <= STEP.times * usual or gain <= STEP.sure:
        return None
    return _Jump(gain, split, float(np.sqrt(squares - usual)))
