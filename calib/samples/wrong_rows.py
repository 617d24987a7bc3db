"""Wrong rows of a log: single ones that contradict their neighbours.

One policy for whoever learns from a log or compares it: `screen` before anything is fitted,
`contradictions` with what a fit or a model predicts.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.robust import robust_solve
from ..common.rows import row_lengths, thinned
from ..common.scale import Scale
from .diagnosis import aligned
from .samples import Samples
from .settings import WRONG
from .sound_values import rows_in_words


def screen(samples: Samples) -> tuple[Mask, list[str]]:
    """Find the `contradictions` of positions that are grossly wrong, before anything is fitted.

    They are compared with a robust fit of all that a chain of rigid links can do, the products of
    1, cos, sin of the joints; where the rows are too few for that (45 of two joints, 135 of three),
    with the robot's nominal kinematics.
    """
    n = len(samples)
    turns = samples.revolute
    terms = int(np.prod([3 if turning else 2 for turning in turns]))
    fitted = min(n, WRONG.fitted)
    rows = np.random.default_rng(0).choice(n, fitted, replace=False)
    enough = WRONG.rows_per_term * terms <= min(samples.poses, fitted)
    if enough and terms <= WRONG.terms:
        features = _products(samples.q[rows], turns)
        coefficients = robust_solve(features, samples.x[rows])
        pieces = np.array_split(samples.q, 1 + n // 50_000)  # held at once
        predicted = np.concatenate(
            [_products(q, turns) @ coefficients for q in pieces]
        )
    elif samples.arm is not None:
        nominal = samples.arm.forward(samples.q)
        predicted = aligned(nominal, samples.x, affine=samples.unit == "px")
    else:
        return np.ones(n, dtype=bool), []
    return contradictions(samples, samples.x - predicted)


def _products(q: Array, turns: tuple[bool, ...]) -> Array:
    """Products (n, terms) of 1, cos and sin of joints that turn, 1 and the value of others."""
    products = np.ones((len(q), 1))
    for values, turning in zip(q.T, turns, strict=True):
        terms = [np.ones(len(q)), np.cos(values), np.sin(values)]
        if not turning:
            terms = [np.ones(len(q)), values]
        pairs = products[:, :, None] * np.stack(terms, axis=1)[:, None]
        products = pairs.reshape(len(q), -1)
    return products


def contradictions(samples: Samples, residual: Array) -> tuple[Mask, list[str]]:
    """Find rows whose residual is gross, and far from those of the rows around them.

    A misfit of the prediction, or a corner where the sensor is worse, concerns neighbours alike.
    A row that has no neighbours contradicts none.

    residual : (n, m), measured less predicted positions, NaN where nothing is predicted
    Returns sound : (n,), False for a row to leave out; all are sound if these were over a quarter
    Returns notes : how many were left out, and which come first
    """
    n = len(samples)
    sound = np.ones(n, dtype=bool)
    size = np.nan_to_num(row_lengths(residual))
    low, high = np.quantile(samples.x, (0.05, 0.95), axis=0)
    limit = max(
        WRONG.gross * float(np.median(size)),
        WRONG.spread * float(np.quantile(size, 0.7)),
        WRONG.share * float(np.linalg.norm(high - low)),
    )
    suspects = np.flatnonzero(size > limit)
    if not len(suspects):
        return sound, []
    from scipy.spatial import cKDTree

    scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
    u = scale.to_unit(samples.q)
    box = scale.periodic.astype(float) if scale.periodic.any() else None
    tree = cKDTree(u, boxsize=box)
    around = min(WRONG.around, n - 1) + 1  # with the row itself
    some = u[thinned(n, WRONG.fitted)]
    usual = float(np.median(tree.query(some, k=[around])[0]))
    nearest = np.arange(1, around + 1)
    reach, near = map(np.asarray, tree.query(u[suspects], k=nearest))
    close = reach[:, -1] <= WRONG.near * usual
    suspects = suspects[close]
    near = near[close]
    others = residual[near]
    others[near == suspects[:, None]] = np.nan
    middle = np.nanmedian(others, axis=1)
    apart = np.linalg.norm(others - middle[:, None], axis=2)
    scatter = np.nanmedian(apart, axis=1)
    away = row_lengths(residual[suspects] - middle)
    wrong = suspects[away > np.maximum(limit, WRONG.apart * scatter)]
    if not 0 < len(wrong) <= WRONG.most * n:
        return sound, []
    sound[wrong] = False
    return sound, [
        f"left out, of learning and of the errors, {len(wrong):,} of {n:,} rows that "
        f"contradict their neighbours: {row_numbers(samples, wrong)}"
    ]


def row_numbers(samples: Samples, rows: Index) -> str:
    """Name the first of some rows by their numbers in the log's file, counted below its header."""
    if samples.rows is None:
        return rows_in_words(rows + 1)
    return rows_in_words(samples.rows[rows])
