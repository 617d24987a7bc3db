"""Which nodes carry local models, and of which shape: by held-out errors, silent within noise.

Folds are contiguous blocks of rows, because neighbouring rows of a real log can be
near-repeats that would flatter a model split row by row.  ``docs/maps.md`` has the figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from ..body.fitting import BodyFit
from ..common.arrays import Array, Index, Mask
from ..common.scale import Scale
from . import local_models as local
from .local_models import NO_MODELS
from .map import Map, nearest_points
from .predictor import BodyInBox, Predictor, Smooth

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
_MOST = 1_000  # rows whose held-out errors are told


_MEANS = 30  # rows whose residuals are averaged
_CHANCE = 4.0  # standard errors by which a mean square must exceed the common one
_FEWEST = 5  # rows that tell a mean
_SPREADS = 6.0  # standard deviations of the calm mean squares, the same
_MANY = 20_000  # rows that are averaged over; more tell no more


@dataclass(frozen=True)
class SmoothCandidate:
    """A smooth part, with what it leaves over of rows that it has and has not seen."""

    smooth: Smooth  # fitted to all samples
    residual: Array  # (n, m), positions less its predictions
    held_out: Array  # (n, m), the same of smooth parts that have not seen the row's fold


@dataclass(frozen=True)
class Selected:
    """A predictor and what cross-validation found of it."""

    predictor: Predictor  # fitted to all samples
    rows: Index  # (k,), rows that were held out in turn
    residual: Array  # (k, m), their positions less predictions that had not seen them

    @property
    def errors(self) -> Array:
        """Distances (k,) between positions and predictions."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))


def blocks(n: int, folds: int = 10) -> list[Index]:
    """Contiguous blocks of the rows 0 ... n - 1."""
    return np.array_split(np.arange(n), min(folds, n))


def of_body(fit: BodyFit, scale: Scale, u: Array, x: Array) -> SmoothCandidate:
    """The candidate that a fitted body is."""
    smooth = BodyInBox(fit.body, scale)
    return SmoothCandidate(smooth, x - smooth.value(u), fit.held_out)


def better(errors: Array, others: Array, least: float = 0.0) -> bool:
    """Whether paired held-out errors are smaller by more than chance and than `least`."""
    gain = others - errors
    chance = 2.0 * float(gain.std()) / np.sqrt(len(gain))
    return bool(gain.mean() > max(chance, least, 0.03 * float(others.mean())))


def follows_the_motion(x: Array, residual: Array) -> bool:
    """Whether residuals (n, o) of rows at positions (n, o) point along the rows' motion.

    A late clock leaves -speed x delay along the path, a play its half: what depends on the
    direction in which a place was passed is no function of the joints.  The mean along the path has
    to exceed a tenth of the residuals and five standard errors of twenty blocks of rows.
    """
    way = np.gradient(x, axis=0)
    length = np.linalg.norm(way, axis=1, keepdims=True)
    along = np.einsum("no,no->n", residual, way / np.maximum(length, 1e-300))
    size = float(np.median(np.linalg.norm(residual, axis=1)))
    means = np.array([along[part].mean() for part in blocks(len(x), _PARTS)])
    chance = float(means.std()) / np.sqrt(len(means))
    return bool(abs(np.median(means)) > max(_SURE * chance, _ALONG * size))


def select(motor: Map, u: Array, candidate: SmoothCandidate) -> Selected:
    """Give nodes local models of one shape where that mends what a smooth part leaves over.

    Nodes that stand among wrong rows may speak; those that mend held-out rows do.  Cost of a row is
    log(1 + |residual|^2 / noise): to halve a large error counts the same wherever it is.  The shape
    with the least cost is taken.

    u : (n, dof), joints of the samples in their order, in the unit box
    """
    n, dof, held = *u.shape, candidate.held_out
    told = np.arange(0, n, max(1, n // _MOST))
    plain = Selected(Predictor(motor, candidate.smooth, NO_MODELS), told, held[told])
    x = candidate.smooth.value(u) + candidate.residual
    shapes = [s for s in _SHAPES if 1.2 * comb(dof + s[0], dof) <= s[1] < n // 4]
    if not shapes or follows_the_motion(x, held):
        return plain
    near = nearest_points(u, motor.scale, u, _AROUND)[1]
    # neighbours share what a smooth part misses: their difference is noise
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    apart = float(np.median(_square(held - held[near[:, 1]])))
    noise = max(apart / (2.0 * np.log(2.0)), (_ROUNDING * extent) ** 2, 1e-300)
    calm = np.median(_square(held)[near], axis=1) < _CALM * noise
    index, weight, gap = local.speaking(motor, u)
    stands = _of_nodes(motor, index, weight * (~calm[:, None] - _SPEAKS)) > 0.0
    rows = np.flatnonzero(stands[index].any(axis=1))
    index, weight, gap = index[rows], weight[rows], gap[rows]
    care = np.where(calm[rows], _HARM, 1.0)
    part = rows * _PARTS // n

    def gains(residual: Array) -> Array:
        """By how much the cost of each row is less than without local models."""
        before, after = (np.log1p(_square(r) / noise) for r in (held[rows], residual))
        return np.asarray(care * (before - after))

    def remains(said: Array, speaks: Mask) -> Array:
        own = np.where(speaks[index], weight, 0.0)
        own *= local.heard(own.sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-300))[:, None]
        return np.asarray(held[rows] - np.einsum("nm,nmo->no", own, said))

    most, best = 0.0, None
    for shape in shapes if len(rows) else ():
        said = _held_out(motor, u, candidate, rows, index, gap, shape)
        each = weight * gains(remains(said, stands))[:, None]
        by_part = np.stack(
            [_of_nodes(motor, index[part == k], each[part == k]) for k in range(_PARTS)]
        )
        speaks = stands & _beyond_chance(by_part, _GAINS)
        residual = remains(said, speaks)
        gain = np.asarray(np.bincount(part, gains(residual), _PARTS), dtype=float)
        if gain.sum() > most and _beyond_chance(gain, _BEYOND):
            most, best = float(gain.sum()), (shape, np.flatnonzero(speaks), residual)
    if best is None:
        return plain
    shape, nodes, residual = best
    mended = held.copy()
    mended[rows] = residual
    models = local.fit(motor, nodes, u, candidate.residual, shape)
    return Selected(Predictor(motor, candidate.smooth, models), told, mended[told])


def _square(residual: Array) -> Array:
    return np.asarray(np.einsum("...o,...o->...", residual, residual))


def _of_nodes(motor: Map, index: Index, values: Array) -> Array:
    """Sum of values (n, m) over the rows, by the nodes `index` (n, m) that they belong to."""
    return np.asarray(np.bincount(index.ravel(), values.ravel(), motor.size), dtype=float)


def _beyond_chance(parts: Array, errors: float) -> Any:
    """Whether sums of parts (k, ...) of a log exceed zero by so many standard errors."""
    return parts.mean(axis=0) > errors * parts.std(axis=0) / np.sqrt(len(parts))


def _held_out(
    motor: Map,
    u: Array,
    candidate: SmoothCandidate,
    rows: Index,
    index: Index,
    gap: Array,
    shape: tuple[int, int],
) -> Array:
    """What each node that has not seen a row's fold says of the row, (rows, nodes, o)."""
    said = np.zeros((*index.shape, candidate.residual.shape[1]))
    for fold in blocks(len(u), _FOLDS):
        mine = np.flatnonzero((rows >= fold[0]) & (rows <= fold[-1]))
        if len(mine):
            others = np.setdiff1d(np.arange(len(u)), fold, assume_unique=True)
            seen = u[others], candidate.residual[others]
            models = local.fit(motor, np.unique(index[mine]), *seen, shape)
            said[mine] = local.contributions(models, index[mine], gap[mine])
    return said


def misfit(scale: Scale, u: Array, held: Array, extent: float, at: Array) -> Array | None:
    """Mean square (k,) of held-out residuals around points beyond noise, None where all is noise.

    The median over the samples is taken for the noise and subtracted.  A mean square that exceeds
    it by no more than chance counts as zero, so that noise draws no nodes.

    u, held : (n, dof), (n, m) [unit], joints in the unit box, and what a smooth model that has not
        seen the row leaves over
    extent : [unit], diagonal of the workspace
    at : (k, dof), the points, in the unit box: what a map will learn from
    """
    floor = (_ROUNDING * extent) ** 2
    square = np.maximum(np.einsum("no,no->n", held, held), floor)
    k = min(_MEANS, len(u) // 4)
    if k < _FEWEST or square.mean() <= 2.0 * floor:
        return None
    some = slice(None, None, -(-len(u) // _MANY))
    seen, square = u[some], square[some]

    def around(points: Array) -> Array:
        index = nearest_points(seen, scale, points, k)[1]
        # without the largest: an outlier is no misfit
        return np.asarray(np.sort(square[index], axis=1)[:, : k - k // 5].mean(axis=1))

    own = around(seen)
    noise = float(np.median(own))
    # a mean of o k squares of noise is noise (1 +- sqrt(2 / (o k)))
    chance = _CHANCE * np.sqrt(2.0 / (held.shape[1] * k))
    # repeated rows tell less than their number: the calm half shows how much
    spread = noise - float(np.quantile(own, 0.16))
    least = noise + max(noise * chance, _SPREADS * spread)
    if np.count_nonzero(own > least) <= k:
        return None
    here = own if at is u and len(own) == len(u) else around(at)
    return np.where(here > least, here - noise, 0.0)
