"""Which nodes carry local models, and of which shape: by held-out errors, silent within noise.

Folds are contiguous: neighbouring rows of a real log can be near-repeats.  Figures: docs/maps.md.
"""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.scale import Scale
from . import local_models as local
from .local_models import NO_MODELS
from .map import Map, nearest_points
from .predictor import Predictor, Smooth

_FOLDS = 5
_SHAPES = ((0, 30), (1, 50), (3, 40), (5, 60))
"""Degrees of a local model and numbers of samples that it is fitted to."""

_ROUNDING = 1e-9  # share of the extent that is no residual
_AROUND = 9  # rows whose median residual tells whether a row is calm
_CALM = 2.0  # times the noise's mean square, below which that median is calm
_HARM = 30.0  # weight of a calm row: what mends a defect must not spoil what is right beside it
_SPEAKS = 0.5  # of a node's weight on wrong rows, above which it may speak
_PARTS = 20  # parts of a log: a gain has to come from several, near-repeats are no evidence
_GAINS, _BEYOND = 1.0, 3.0  # standard errors beyond zero, of a node's gain and of the sum
_ALONG, _SURE = 0.1, 5.0  # see `follows_the_motion`

_MEANS = 30  # rows whose residuals are averaged
_CHANCE = 4.0  # standard errors by which a mean square must exceed the common one
_SPREADS = 6.0  # standard deviations of the calm mean squares, the same


def blocks(n: int, folds: int = 10) -> list[Index]:
    """Contiguous blocks of the rows 0 ... n - 1."""
    return np.array_split(np.arange(n), min(folds, n))


def better(errors: Array, others: Array) -> bool:
    """Whether paired held-out errors are smaller by more than chance."""
    gain = others - errors
    chance = 2.0 * float(gain.std()) / np.sqrt(len(gain))
    return bool(gain.mean() > max(chance, 0.03 * float(others.mean())))


def follows_the_motion(x: Array, residual: Array) -> bool:
    """Whether residuals (n, o) of rows at positions (n, o) point along the rows' motion.

    A late clock leaves -speed x delay along the path, a play its half: no function of the joints.
    The mean along it has to exceed a tenth of their size and five standard errors of twenty blocks.
    """
    way = np.gradient(x, axis=0)
    length = np.linalg.norm(way, axis=1, keepdims=True)
    along = np.einsum("no,no->n", residual, way / np.maximum(length, 1e-300))
    size = float(np.median(np.linalg.norm(residual, axis=1)))
    means = np.array([along[part].mean() for part in blocks(len(x), _PARTS)])
    chance = float(means.std()) / np.sqrt(len(means))
    return bool(abs(np.median(means)) > max(_SURE * chance, _ALONG * size))


def select(motor: Map, u: Array, x: Array, smooth: Smooth, held: Array) -> tuple[Predictor, Array]:
    """Give nodes local models of one shape where that mends what a smooth part leaves over.

    Nodes that stand among wrong rows may speak; those that mend held-out rows do.  Cost of a row is
    log(1 + |residual|^2 / noise): to halve a large error counts the same wherever it is.  The shape
    with the least cost is taken.

    u, x : (n, dof), (n, m), joints of the samples in the unit box, in their order, and positions
    smooth : the smooth part, fitted to all samples
    held : (n, m), what smooth parts leave over that have not seen the row's fold
    Returns the predictor, and what is left of `held` where local models have not seen the row.
    """
    n, dof, residual = *u.shape, x - smooth.value(u)
    plain = Predictor(motor, smooth, NO_MODELS), held
    shapes = [s for s in _SHAPES if 1.2 * comb(dof + s[0], dof) <= s[1] < n // 4]
    if not shapes or follows_the_motion(x, held):
        return plain
    near = nearest_points(u, motor.scale, u, _AROUND)[1]
    # neighbours share what a smooth part misses: their difference is noise
    apart = float(np.median(_square(held - held[near[:, 1]])))
    noise = max(
        apart / (2.0 * np.log(2.0)), (_ROUNDING * np.linalg.norm(np.ptp(x, axis=0))) ** 2, 1e-300
    )
    calm = np.median(_square(held)[near], axis=1) < _CALM * noise
    index, weight, gap = local.speaking(motor, u)
    stands = _of_nodes(motor, index, weight * (~calm[:, None] - _SPEAKS)) > 0.0
    rows = np.flatnonzero(stands[index].any(axis=1))
    index, weight, gap, part = index[rows], weight[rows], gap[rows], rows * _PARTS // n
    before, care = np.log1p(_square(held[rows]) / noise), np.where(calm[rows], _HARM, 1.0)

    def remaining(said: Array, talks: Mask) -> tuple[Array, Array]:
        """What is left of each row, and by how much its cost is less than before."""
        own = local.heard(weight, talks[index])
        left = held[rows] - np.einsum("nm,nmo->no", own, said)
        return left, care * (before - np.log1p(_square(left) / noise))

    most, best = 0.0, None
    for shape in shapes if len(rows) else ():
        said = np.zeros((*index.shape, x.shape[1]))  # by nodes that have not seen the row's fold
        for fold in blocks(n, _FOLDS):
            mine = np.flatnonzero((rows >= fold[0]) & (rows <= fold[-1]))
            seen = np.setdiff1d(np.arange(n), fold, assume_unique=True)
            models = local.fit(motor, np.unique(index[mine]), u[seen], residual[seen], shape)
            said[mine] = local.contributions(models, index[mine], gap[mine])
        each = weight * remaining(said, stands)[1][:, None]
        of_part = [_of_nodes(motor, index[part == k], each[part == k]) for k in range(_PARTS)]
        talks = stands & _beyond_chance(np.stack(of_part), _GAINS)
        left, gain = remaining(said, talks)
        total = np.bincount(part, gain, _PARTS).astype(float)
        if total.sum() > most and _beyond_chance(total, _BEYOND):
            most, best = float(total.sum()), (shape, np.flatnonzero(talks), left)
    if best is None:
        return plain
    shape, nodes, left = best
    mended = held.copy()
    mended[rows] = left
    models = local.fit(motor, nodes, u, residual, shape)
    return Predictor(motor, smooth, models), mended


def _square(residual: Array) -> Array:
    return np.asarray(np.einsum("...o,...o->...", residual, residual))


def _of_nodes(motor: Map, index: Index, values: Array) -> Array:
    """Sum of values (n, m) over the rows, by the nodes `index` (n, m) that they belong to."""
    return np.asarray(np.bincount(index.ravel(), values.ravel(), motor.size), dtype=float)


def _beyond_chance(parts: Array, errors: float) -> Any:
    """Whether sums of parts (k, ...) of a log exceed zero by so many standard errors."""
    return parts.mean(axis=0) > errors * parts.std(axis=0) / np.sqrt(len(parts))


def misfit(scale: Scale, u: Array, held: Array, extent: float, at: Array) -> Array | None:
    """Mean square (k,) of held-out residuals around points beyond noise, None where all is noise.

    The median over the points is taken for the noise and subtracted.  A mean square that exceeds
    it by no more than chance counts as zero, so that noise draws no nodes.

    u, held : (n, dof), (n, m) [unit], joints in the unit box, and what a smooth model that has not
        seen the row leaves over
    extent : [unit], diagonal of the workspace
    at : (k, dof), the points, in the unit box: what a map will learn from
    """
    square, k = np.maximum(_square(held), (_ROUNDING * extent) ** 2), min(_MEANS, len(u) // 4)
    index = nearest_points(u, scale, at, k)[1]
    # without the largest: an outlier is no misfit
    here = np.sort(square[index], axis=1)[:, : k - k // 5].mean(axis=1)
    noise, low = (float(v) for v in np.quantile(here, (0.5, 0.16)))
    # a mean of o k squares of noise is noise (1 +- sqrt(2 / (o k))); repeated rows tell less than
    # their number: the calm half shows how much
    chance = _CHANCE * np.sqrt(2.0 / (held.shape[1] * k)) * noise
    excess = np.where(here > noise + max(chance, _SPREADS * (noise - low)), here - noise, 0.0)
    return excess if np.count_nonzero(excess) > k * len(at) / len(u) else None
