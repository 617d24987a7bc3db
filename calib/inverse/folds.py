"""Folds: where the Jacobian loses a direction two ways meet, and one leads to the other."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Index
from .newton import Newton, Stand
from .settings import SEARCH


def twins(newton: Newton, stand: Stand, folded: float) -> tuple[Index, Array]:
    """Rows (k,) near a fold, and starts (k, dof) for the ways across it.

    Along the direction that hardly moves the tip the least singular value falls linearly to zero,
    and the other way lies about as far beyond as this one lies before.

    folded : least singular value beside a fold, of the Jacobian's squares
    """
    sides, size, directions = np.linalg.svd(stand.slope, full_matrices=False)
    squares = size * size
    least = folded * squares.sum(axis=1)
    rows = np.flatnonzero(squares[:, -1] <= least)
    if not len(rows):
        return rows, stand.u[rows]
    here = stand.rows(rows)
    flat = directions[rows, -1]
    side = sides[rows, :, -1]
    ahead = newton.task.residual(here.u + SEARCH.probe * flat, here.x)[1]
    change = (ahead - here.slope) / SEARCH.probe
    along = (change @ flat[:, :, None])[:, :, 0]
    rate = (side * along).sum(axis=1)
    rate[rate == 0.0] = np.inf
    reach = -2.0 * size[rows, -1] / rate
    near = (np.abs(reach) < SEARCH.beyond) & (reach != 0.0)
    across = here.u[near] + reach[near, None] * flat[near]
    return rows[near], newton.clip(across)
