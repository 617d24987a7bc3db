"""Wrong rows of a log: single ones that contradict their neighbours, and corners that contradict.

One policy for whoever learns from a log or compares it: `screen` before anything is fitted,
`contradictions` with what a fit or a model predicts.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.robust import robust_solve
from ..common.rows import thinned
from ..common.scale import Scale
from ..common.wording import for_people
from . import settings
from .diagnosis import aligned
from .samples import Samples


def screen(samples: Samples) -> tuple[Mask, list[str]]:
    """Find the `contradictions` of positions that are grossly wrong, before anything is fitted.

    They are compared with a robust fit of all that a chain of rigid links can do, the products of
    1, cos, sin of the joints; where the rows are too few for that (45 of two joints, 135 of three),
    with the robot's nominal kinematics.
    """
    n = len(samples)
    kinds = samples.revolute
    rows = np.random.default_rng(0).choice(
        n, min(n, settings.FITTED_ROWS), replace=False
    )
    terms = int(np.prod([3 if turns else 2 for turns in kinds]))

    def features(q: Array) -> Array:
        parts = [
            np.stack([v**0, np.cos(v), np.sin(v)] if turns else [v**0, v], axis=1)
            for v, turns in zip(q.T, kinds, strict=True)
        ]
        return reduce(
            lambda a, b: (a[:, :, None] * b[:, None]).reshape(len(q), -1), parts
        )

    if (
        settings.ROWS_PER_TERM * terms <= min(samples.poses, len(rows))
        and terms <= settings.TERMS
    ):
        coefficients = robust_solve(features(samples.q[rows]), samples.x[rows])
        pieces = np.array_split(samples.q, 1 + n // 50_000)  # that are held at once
        predicted = np.concatenate([features(q) @ coefficients for q in pieces])
    elif samples.arm is not None:
        nominal = samples.arm.forward(samples.q)
        predicted = aligned(nominal, samples.x, affine=samples.unit == "px")
    else:
        return np.ones(len(samples), dtype=bool), []
    return contradictions(samples, samples.x - predicted)


def contradictions(samples: Samples, residual: Array) -> tuple[Mask, list[str]]:
    """Find rows whose residual is gross, and far from those of the rows around them.

    A misfit of the prediction, or a corner where the sensor is worse, concerns neighbours alike.
    A row that has no neighbours contradicts none.

    residual : (n, m), measured less predicted positions, NaN where nothing is predicted
    Returns kept : (n,), False for a row to leave out; all are kept if these were over a quarter
    Returns notes : how many were left out, and which come first
    """
    kept = np.ones(len(samples), dtype=bool)
    suspects, limit = _gross(samples, residual)
    if not len(suspects):
        return kept, []
    from scipy.spatial import cKDTree

    scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
    u = scale.to_unit(samples.q)
    around = min(settings.AROUND, len(samples) - 1)
    tree = cKDTree(
        u, boxsize=scale.periodic.astype(float) if scale.periodic.any() else None
    )
    some = thinned(len(u), settings.FITTED_ROWS)
    usual = float(np.median(tree.query(u[some], k=[around + 1])[0]))
    reach, near = map(np.asarray, tree.query(u[suspects], k=np.arange(1, around + 2)))
    close = reach[:, -1] <= settings.NEAR * usual
    suspects = suspects[close]
    near = near[close]
    others = residual[near]
    others[near == suspects[:, None]] = np.nan  # a row is no neighbour of its own
    middle = np.nanmedian(others, axis=1)
    scatter = np.nanmedian(np.linalg.norm(others - middle[:, None], axis=2), axis=1)
    away = np.linalg.norm(residual[suspects] - middle, axis=1)
    wrong = suspects[away > np.maximum(limit, settings.APART * scatter)]
    if not 0 < len(wrong) <= settings.MOST_WRONG * len(kept):
        return kept, []
    kept[wrong] = False
    return kept, [
        f"left out, of learning and of the errors, {len(wrong):,} of {len(kept):,} rows that "
        f"contradict their neighbours: {row_numbers(samples, wrong)}"
    ]


def contradicting_corner(samples: Samples, residual: Array) -> str:
    """Say that rows which stand together are all off by the same; empty where none are.

    residual : (n, m), measured less predicted positions; the prediction is one that few rows do
        not move, such as a fit with Student noise
    """
    suspects, _ = _gross(samples, residual)
    if not settings.LEAST_CORNER <= len(suspects) <= settings.MOST_WRONG * len(samples):
        return ""
    shift = np.median(residual[suspects], axis=0)
    size = float(np.linalg.norm(shift))
    together = suspects[np.linalg.norm(residual[suspects] - shift, axis=1) < 0.5 * size]
    if len(together) < max(settings.LEAST_CORNER, 0.5 * len(suspects)):
        return ""
    low, high = np.quantile(samples.q[together], (0.02, 0.98), axis=0)
    inside = ((samples.q >= low) & (samples.q <= high)).all(axis=1)
    if inside.mean() > 0.5 or np.isin(np.flatnonzero(inside), together).mean() < 0.5:
        return ""  # they are all over the range
    factor, unit = for_people(samples.unit)
    return (
        f"a corner contradicts the rest: {len(together):,} of {len(samples):,} rows that stand "
        f"together are off by {factor * size:.3g} {unit}, all the same way; was the sensor or the "
        f"arm disturbed there? measure these again or leave them out: "
        f"{row_numbers(samples, together)}"
    )


def row_numbers(samples: Samples, rows: Index) -> str:
    """Name the first of some rows by their numbers in the log's file, counted below its header."""
    return rows_in_words(rows + 1 if samples.rows is None else samples.rows[rows])


def rows_in_words(numbers: Index) -> str:
    """Name the first of some numbers of rows."""
    shown = f"{', '.join(map(str, numbers[:5]))}{', ...' if len(numbers) > 5 else ''}"
    return f"row{'s' * (len(numbers) > 1)} {shown}"


def _gross(samples: Samples, residual: Array) -> tuple[Index, float]:
    """Rows whose residual (n, m) is gross by the standard of all rows, and the limit."""
    size = np.nan_to_num(np.linalg.norm(residual, axis=1))
    low, high = np.quantile(samples.x, (0.05, 0.95), axis=0)
    limit = max(
        settings.GROSS * float(np.median(size)),
        settings.SPREAD * float(np.quantile(size, 0.7)),
        settings.GROSS_SHARE * float(np.linalg.norm(high - low)),
    )
    return np.flatnonzero(size > limit), limit
