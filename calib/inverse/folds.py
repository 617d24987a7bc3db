"""Folds: where the Jacobian loses a direction two ways meet, and one leads to the other."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Index
from .newton import Newton, Stand
from .settings import SEARCH


def twins(newton: Newton, stand: Stand, folded: float) -> tuple[Index, Array]:
    """Rows (k,) near a fold, and starts (k, dof) for the ways across it.

    Along the direction v that hardly moves the tip the least singular value s = w' J v falls
    linearly to zero, at a rate ``w' (dJ/dv) v``, and the other way lies about as far beyond as this
    one lies before.

    folded : least singular value beside a fold, of the Jacobian's squares
    """
    sides, size, directions = np.linalg.svd(stand.slope, full_matrices=False)
    squares = size * size
    power = squares.sum(axis=1)
    folds = squares[:, -1] <= folded * power
    rows = np.flatnonzero(folds)
    if not len(rows):
        return rows, stand.u[rows]
    here = stand.rows(rows)
    flat = directions[rows, -1]
    side = sides[rows, :, -1]
    probe = here.u + SEARCH.probe * flat
    _, ahead = newton.task.residual(probe, here.x)
    change = (ahead - here.slope) / SEARCH.probe
    columns = change @ flat[:, :, None]
    along = columns[:, :, 0]
    rate = (side * along).sum(axis=1)
    rate[rate == 0.0] = np.inf
    least = size[rows, -1]
    reach = -2.0 * least / rate
    near = np.abs(reach) < SEARCH.beyond
    near &= reach != 0.0
    shift = reach[near, None] * flat[near]
    across = here.u[near] + shift
    return rows[near], newton.clip(across)
