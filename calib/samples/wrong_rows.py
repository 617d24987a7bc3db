"""Wrong rows of a log: single ones that contradict their neighbours.

One policy for whoever learns from a log or compares it, with what a fit or a model predicts.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import row_lengths, spread_rows
from .samples import Samples
from .settings import WRONG
from .tables import rows_in_words


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

    scale = samples.unit_box
    u = scale.to_unit(samples.q)
    box = scale.periodic.astype(float) if scale.periodic.any() else None
    tree = cKDTree(u, boxsize=box)
    around = min(WRONG.around, n - 1) + 1  # with the row itself
    some = u[spread_rows(n, WRONG.fitted)]
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
        f"contradict their neighbours: {rows_in_words(samples.rows[wrong])}"
    ]
