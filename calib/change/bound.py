"""The test of the bound: whether more rows than chance lie beyond what a model tells of itself."""

from __future__ import annotations

import math

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.parameters import Indices
from ..common.arrays import Array
from .score import GroupTest, Tested
from .settings import BEYOND, FALSE_ALARM, FEW

_LASTING = 10  # rows over which noise may last


def bound_test(
    tested: Tested, rows: Indices, u: Array, residual: Array, bound: Array, shared: Array,
    slope: Array | None,
) -> tuple[float, GroupTest]:  # fmt: skip
    """Share of the rows beyond the 95 % bound, and how surely these are too many to be noise.

    rows, u : (n,) and (n, dof), their numbers in the log and their joints in the unit box
    residual, bound : (n, m) and (n,) [unit], infinite where the model tells none
    shared : (n,), variance of an axis by what all rows share
    slope : (n, m), motion of the tip by a joint whose encoder is noisy
    """
    from scipy.special import bdtrc, chdtri

    square, m = (residual**2).sum(axis=1), residual.shape[1]
    radius = float(chdtri(m, 0.05))  # squared, of 95 % of a Gaussian, in units of a deviation
    more = max(tested.noise**2 - tested.usual**2, 0.0)
    if len(rows) < FEW:  # half of the rows of a noisier sensor are nearer than its median
        more = max(more, float(np.median(square)) / float(chdtri(m, 0.5)) - tested.usual**2)
    alike = more and _alike(rows, u, residual) * radius > float(np.median(bound)) ** 2
    noise = np.full(len(rows), 0.0 if alike else more)
    if tested.noisy is not None and slope is not None:
        noise += tested.noisy[1] ** 2 * (slope**2).sum(axis=1)
    over = square > bound**2 + radius * (shared + noise)
    # rows that err together count once
    time = autocorrelation_time(over[:, None].astype(float)) if over.any() else 1.0
    count, n = int(over.sum() / time), math.ceil(len(over) / time)
    p = float(bdtrc(count - 1, n, BEYOND)) if count else 1.0
    beyond = float(np.mean(square > bound**2 + radius * shared))
    return beyond, GroupTest("bound", p, -2.0 * math.log(max(p, 1e-300)))


def _alike(rows: Indices, u: Array, residual: Array) -> float:
    """Variance of an axis by which rows of like joints err alike, 0 where that may be chance."""
    from scipy.spatial import cKDTree
    from scipy.special import ndtri

    # of so many rows at least one is no neighbour in time: noise may last over some rows
    near = np.asarray(cKDTree(u).query(u, min(2 * _LASTING + 2, len(u)))[1])
    later = np.abs(rows[near] - rows[:, None]) > _LASTING
    row = np.flatnonzero(later.any(axis=1))
    if not len(row):
        return 0.0
    pairs = np.stack([row, near[row, later[row].argmax(axis=1)]], axis=1)
    first, second = np.unique(np.sort(pairs, axis=1), axis=0).T
    product = (residual[first] * residual[second]).sum(axis=1)
    # whatever its size, noise makes either sign as likely
    sure = product.sum() > -ndtri(FALSE_ALARM) * np.linalg.norm(product)
    return float(product.mean()) / residual.shape[1] if sure else 0.0
