"""Wrong rows: those that contradict the others of their log."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.rows import row_lengths, spread_rows
from ..samples.samples import Samples
from ..samples.tables import rows_in_words
from .settings import WRONG


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
    limit = _gross(samples.x, residual)
    suspects = np.flatnonzero(np.nan_to_num(row_lengths(residual)) > limit)
    if not len(suspects):
        return sound, []
    suspects, neighbours = _with_neighbours(samples, suspects)
    around = residual[neighbours]
    around[neighbours == suspects[:, None]] = np.nan
    middle = np.nanmedian(around, axis=1)
    distances = np.linalg.norm(around - middle[:, None], axis=2)
    scatter = np.nanmedian(distances, axis=1)
    deviation = row_lengths(residual[suspects] - middle)
    wrong = suspects[deviation > np.maximum(limit, WRONG.scatters * scatter)]
    if not 0 < len(wrong) <= WRONG.most_rows * n:
        return sound, []
    sound[wrong] = False
    return sound, [
        f"left out, of learning and of the errors, {len(wrong):,} of {n:,} rows that "
        f"contradict their neighbours: {rows_in_words(samples.rows[wrong])}"
    ]


def _gross(x: Array, residual: Array) -> float:
    """Length [unit] beyond which residuals (n, m) at positions (n, m) are gross."""
    size = np.nan_to_num(row_lengths(residual))
    low, high = np.quantile(x, (0.05, 0.95), axis=0)
    return max(
        WRONG.gross * float(np.median(size)),
        WRONG.spread * float(np.quantile(size, 0.7)),
        WRONG.share * float(np.linalg.norm(high - low)),
    )


def _with_neighbours(samples: Samples, rows: Index) -> tuple[Index, Index]:
    """Those of some rows that have near neighbours (k,), and these (k, r), themselves included."""
    from scipy.spatial import cKDTree

    n = len(samples)
    scale = samples.unit_box
    u = scale.to_unit(samples.q)
    box = scale.periodic.astype(float) if scale.periodic.any() else None
    tree = cKDTree(u, boxsize=box)
    count = min(WRONG.neighbours, n - 1) + 1  # with the row itself
    sample = u[spread_rows(n, WRONG.sampled)]
    usual = float(np.median(tree.query(sample, k=[count])[0]))
    distance, neighbours = map(
        np.asarray, tree.query(u[rows], k=np.arange(1, count + 1))
    )
    is_near = distance[:, -1] <= WRONG.most_distance * usual
    return rows[is_near], neighbours[is_near]
