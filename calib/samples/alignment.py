"""Alignment: predicted positions brought to measured ones, wherever the frame of these stands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arm.rotations import similarity
from ..common.arrays import Array, Mask
from ..common.robust import solve_least_squares
from .settings import DIAGNOSED_ROWS, FAR_BETTER, PATH

Predict = Callable[[Array], Array]
"""Positions (n, m) at joint values (n, dof), NaN where none is known."""


def rows_behind(predict: Predict, q: Array, x: Array, unit: str = "m", most: int = 20) -> int:
    """Return by how many rows positions follow the joints, 0 where no shift fits far better.

    Rows along a path fit nearly as well a row later; poses in any order fit not at all.
    """
    n = len(q)
    most = min(most, n // 5)
    if most < 1:
        return 0
    predicted = predict(q)
    if not np.isfinite(predicted).all():
        return 0
    rows = np.linspace(most, n - 1 - most, min(n - 2 * most, DIAGNOSED_ROWS)).round()
    rows = rows.astype(np.intp)
    found = {
        shift: aligned_misfit(predicted[rows - shift], x[rows], affine=unit == "px")
        for shift in range(-most, most + 1)
    }
    best = min(found, key=lambda shift: (found[shift], abs(shift)))
    return best if found[best] < (0.5 if is_path(q) else FAR_BETTER) * found[0] else 0


def is_path(q: Array, joined: Mask | slice = slice(None)) -> bool:
    """Whether rows (n, dof) are those of a motion, by the steps that are `joined` (n - 1,)."""
    step = np.median(np.abs(np.diff(q, axis=0)[joined]), axis=0)
    return bool(np.max(step / np.maximum(np.ptp(q, axis=0), 1e-12)) <= PATH)


def aligned_misfit(a: Array, b: Array, *, affine: bool = False) -> float:
    """Median distance of `b` (n, m) from `a` (n, k), turned, shifted and scaled.

    Where `affine`, or the one has more coordinates, the best affine map instead.  No reflection: a
    mirrored sensor is to be seen as a misfit.  Rows that contradict most others do not count.
    """
    return float(np.median(np.linalg.norm(b - aligned(a, b, affine=affine), axis=1)))


def aligned(a: Array, b: Array, *, affine: bool = False) -> Array:
    """`a` (n, k), brought to `b` (n, m) whatever a few rows contradict; see `aligned_misfit`."""
    affine = affine or a.shape[1] != b.shape[1]
    features = np.column_stack([a, np.ones(len(a))])
    # spreads about the median: single wrong rows decide nothing
    spread = np.linalg.norm(b - np.median(b, axis=0), axis=1)
    kept = spread <= 5.0 * np.median(spread) + 1e-300
    for _ in range(4):
        if affine:
            moved = features @ solve_least_squares(features[kept], b[kept])
        else:
            turn, shift, scale = similarity(a[kept], b[kept])
            moved = scale * a @ turn.T + shift
        away = np.linalg.norm(b - moved, axis=1)
        kept = away <= 3.0 * np.median(away) + 1e-300
    return np.asarray(moved)


def agreeing(a: Array, b: Array) -> tuple[Array, Array]:
    """Rows of both that one similarity brings together, without those that contradict most."""
    away = np.linalg.norm(b - aligned(a, b), axis=1)
    kept = away <= 3.0 * np.median(away) + 1e-300
    return a[kept], b[kept]
