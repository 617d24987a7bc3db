"""Moved: whether the arm, its tool or the sensor moved while a log was taken."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from ..common.wording import for_people
from .samples import Samples

_ROWS = 1000  # that are compared
_PARTS = 32  # between which the log is split
_LEAST = 20  # poses that both sides of a split must have measured
_SURE = (
    6.0  # standard errors of the logarithm of the ratio, beyond which it is no chance
)
# square differences across a split over those within a side: .5 mm steps hide in noise
_TIMES = 3.0


def moved_words(samples: Samples, predicted: Array) -> list[str]:
    """One line on a log in which something moved; predicted (n, m) [unit] by a fit of all rows."""
    box = (samples.q - samples.lower) / (samples.upper - samples.lower)
    if (found := moved_at(box, samples.x - predicted)) is None:
        return []
    factor, unit = for_people(samples.unit)
    return [
        f"rows from about {found[0] + 1} on are {factor * found[1]:.2g} {unit} off earlier rows of "
        "the same poses: the arm, its tool or the sensor moved while the log was taken, or joints "
        "with play were approached from the other side; train from one part of the log"
    ]


def moved_at(q: Array, residual: Array) -> tuple[int, float] | None:
    """Row from which on residuals are others at the same poses, and by how much.

    A row is compared with its nearest neighbour before and after a split, and only where the one
    across the split is the nearer one: what is smooth along a path, but no arm, is no step in time.

    q : (n, dof), joints over their ranges, in the order of the log
    residual : (n, m), what a fit of all rows leaves [unit]
    Returns (row, typical displacement [unit]), or None where nothing moved or nobody can tell.
    """
    from scipy.spatial import cKDTree  # takes .2 s

    rows = thinned(len(q), _ROWS)
    q = q[rows]
    residual = residual[rows]
    found: list[tuple[float, int, float]] = []
    for k in np.linspace(0, len(q), _PARTS + 1)[1:-1].astype(int).tolist():
        sides = slice(k), slice(k, None)
        if min(k, len(q) - k) < _LEAST:
            continue
        within = []
        across = []
        for own, other in (sides, sides[::-1]):
            nearest: Any = cKDTree(q[own]).query(q[own], 2)
            others: Any = cKDTree(q[other]).query(q[own])
            (near, at), (far, there) = nearest, others
            chosen = far <= near[:, 1]
            left = residual[own]
            within.append(((left - left[at[:, 1]])[chosen] ** 2).sum(axis=1))
            across.append(((left - residual[other][there])[chosen] ** 2).sum(axis=1))
        beyond = np.concatenate(across)
        if min(map(len, within)) < _LEAST // 2 or not np.concatenate(within).any():
            continue
        # a few wild rows are no step: medians; the noise of each side is half of what lies across
        usual = float(np.mean([np.median(w) for w in within]))
        now = float(np.median(beyond))
        error = 2.0 / np.sqrt(residual.shape[1] * len(beyond))
        gain = (
            np.log(max(now, 1e-300) / max(usual, 1e-300)) / error
        )  # exact rows leave nothing
        if now > _TIMES * usual and gain > _SURE:
            found.append((gain, k, np.sqrt(now - usual)))
    if not found:
        return None
    _, k, size = max(found)
    return int(rows[k]), float(size)
