"""Which nodes carry local models, and of which shape: by held-out errors, silent within noise.

Folds are contiguous blocks of rows, because neighbouring rows of a real log can be
near-repeats that would flatter a model split row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body.posterior import BodyFit
from ..common.arrays import Array, Index
from ..common.scale import Scale
from . import local_models as local
from .local_models import NO_MODELS, exponents
from .map import Map, nearest_points
from .misfit import misfit
from .predictor import BodyInBox, Predictor, Smooth

FOLDS = 10
_ROUNDING = 1e-9  # share of the extent that is no improvement
_HELD_OUT = 1000  # rows on which a shape for all nodes is chosen
_SHAPES = ((0, 30), (1, 50), (1, 200), (2, 24), (2, 60), (3, 40), (5, 60))
"""Degrees of a local model and numbers of samples that it is fitted to."""

_MOSTLY = 0.2  # share of calm rows that is enough to tell what serves them
_AROUND = 5  # rows whose median residual tells whether a row is calm
_CALM = 0.99  # quantile of that median where the smooth part is right
_HARM = 30.0  # weight of a calm row: what mends a defect must not spoil what is right beside it
_TURNS = 3  # in which nodes fall silent
_SPEAKS = 0.5  # of a node's weight on wrong rows, above which it speaks
_ALONG, _SURE = 0.1, 5.0  # see `follows_the_motion`
_PARTS, _BEYOND = 20, 3.0  # parts of a log, and standard errors of their mean that are no chance


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
    rows: Index  # (m,), rows that were held out in turn
    # (m, outputs), their positions less the predictions of predictors that had not seen them
    residual: Array

    @property
    def errors(self) -> Array:
        """Distances (m,) between positions and predictions."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))


def blocks(n: int, folds: int = FOLDS) -> list[Index]:
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
    direction in which a place was passed is no function of the joints, and a node that learned it
    would be wrong for the other direction.  The mean along the path has to exceed a tenth of the
    residuals and five standard errors of twenty blocks of rows.
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

    motor : nodes that will carry the local models
    u : (n, dof), joints of the samples in their order, in the unit box
    """
    n, held = len(u), candidate.held_out
    folds = blocks(n)
    use = folds if n <= 5 * _HELD_OUT else folds[::3]
    every = max(1, _HELD_OUT // len(use))
    rows = np.concatenate([part[:: max(1, len(part) // every)] for part in use])
    plain = Selected(Predictor(motor, candidate.smooth, NO_MODELS), rows, held[rows])
    x = candidate.smooth.value(u) + candidate.residual
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    least = _ROUNDING * extent
    shapes = [s for s in _SHAPES if 1.2 * len(exponents(u.shape[1], s[0])) <= s[1] < n // 4]
    if plain.errors.mean() <= least or not shapes or follows_the_motion(x, held):
        return plain
    around = misfit(motor.scale, u, held, extent, u)
    wrong = np.zeros(n, dtype=bool) if around is None else around > 0.0
    calm = ~wrong[rows]
    if np.count_nonzero(calm) < _MOSTLY * len(rows):
        calm[:] = True  # no part of the samples is calm
    found = _everywhere(motor, u, candidate, rows, calm, shapes, least)
    if found is None and wrong.any():
        found = _in_defects(motor, u, candidate, plain, shapes, wrong)
    return found or plain


def _everywhere(
    motor: Map,
    u: Array,
    candidate: SmoothCandidate,
    rows: Index,
    calm: NDArray[np.bool_],
    shapes: Sequence[tuple[int, int]],
    least: float,
) -> Selected | None:
    """A shape for all nodes, where one mends calm held-out rows beyond chance."""
    index, weight, gap = local.speaking(motor, u[rows])
    best, found = candidate.held_out[rows], None
    for shape in shapes:
        said = _held_out(motor, u, candidate, rows, index, gap, shape)
        tried = candidate.held_out[rows] - np.einsum("nm,nmo->no", weight, said)
        errors, others = (np.linalg.norm(each[calm], axis=1) for each in (tried, best))
        if better(errors, others, least):
            best, found = tried, shape
    if found is None:
        return None
    return Selected(_fitted(motor, u, candidate, found, np.arange(motor.size)), rows, best)


def _in_defects(
    motor: Map,
    u: Array,
    candidate: SmoothCandidate,
    plain: Selected,
    shapes: Sequence[tuple[int, int]],
    wrong: NDArray[np.bool_],
) -> Selected:
    """Models of one shape on the nodes that stand in a defect; the others are silent and vote.

    Cost of a held-out row is log(1 + |residual|^2 / noise): to halve a large error counts the
    same wherever it is; a calm row counts 30 times.  Nodes that raise it fall silent in turn, and
    the shape with the least cost is taken.
    """
    held = candidate.held_out
    square = np.einsum("no,no->n", held, held)
    # a median of a few rows tells sooner on which side of a sharp edge a row lies
    near = nearest_points(u, motor.scale, u, _AROUND)[1]
    middle = np.median(square[near], axis=1)
    calm = np.zeros(len(u), dtype=bool)
    if not wrong.all():
        calm = np.asarray(middle <= np.quantile(middle[~wrong], _CALM))
    index, weight, gap = local.speaking(motor, u)
    of_node = np.bincount(index.ravel(), weight.ravel(), motor.size)
    of_wrong = np.bincount(index.ravel(), (weight * ~calm[:, None]).ravel(), motor.size)
    stands = of_wrong > _SPEAKS * of_node
    rows = np.flatnonzero(stands[index].any(axis=1))
    index, weight, gap = index[rows], weight[rows], gap[rows]
    noise = max(float(square[calm].mean()) if calm.any() else float(np.median(square)), 1e-300)
    care = np.where(calm[rows], _HARM, 1.0)

    def cost(residual: Array) -> Array:
        square = np.einsum("no,no->n", residual, residual)
        return np.asarray(care * np.log1p(square / noise))

    before = cost(held[rows])
    least, best = float(before.sum()), None
    for shape in shapes:
        said = _held_out(motor, u, candidate, rows, index, gap, shape)
        speaks = stands.copy()
        for _ in range(_TURNS):
            own = np.where(speaks[index], weight, 0.0)
            own *= local.heard(own.sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-300))[:, None]
            left = held[rows] - np.einsum("nm,nmo->no", own, said)
            after = cost(left)
            if after.sum() < least:
                least, best = float(after.sum()), (shape, np.flatnonzero(speaks), left)
            # a node that spoils more beside a defect than it mends in it falls silent
            gain = np.bincount(index.ravel(), (own * (before - after)[:, None]).ravel(), motor.size)
            speaks &= gain > 0.0
    if best is None:
        return plain
    shape, nodes, left = best
    # neighbouring rows of a log can be near-repeats: a gain has to come from several parts of it
    gains = [float(part.sum()) for part in np.array_split(before - cost(left), _PARTS)]
    if not np.mean(gains) > _BEYOND * np.std(gains) / np.sqrt(_PARTS):
        return plain
    residual = held.copy()
    residual[rows] = left
    return Selected(_fitted(motor, u, candidate, shape, nodes), plain.rows, residual[plain.rows])


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
    degree, samples = shape
    said = np.zeros((*index.shape, candidate.residual.shape[1]))
    for fold in blocks(len(u)):
        mine = np.flatnonzero((rows >= fold[0]) & (rows <= fold[-1]))
        if not len(mine):
            continue
        nodes, place = np.unique(index[mine], return_inverse=True)
        others = np.setdiff1d(np.arange(len(u)), fold, assume_unique=True)
        models = local.fit(
            motor.units[nodes], u[others], candidate.residual[others], motor.scale,
            degree, samples, spacings=motor.spacings[nodes],
        )  # fmt: skip
        said[mine] = local.contributions(models, place.reshape(index[mine].shape), gap[mine])
    return said


def _fitted(
    motor: Map, u: Array, candidate: SmoothCandidate, shape: tuple[int, int], nodes: Index
) -> Predictor:
    """The predictor with models of one shape on some nodes; far from all rows they are silent."""
    found = local.fit(
        motor.units[nodes], u, candidate.residual, motor.scale, *shape,
        spacings=motor.spacings[nodes],
    )  # fmt: skip
    coefficients = np.zeros((motor.size, *found.coefficients.shape[1:]))
    coefficients[nodes] = found.coefficients
    coefficients *= local.near_rows(motor, u)[:, None, None]
    radius = np.full(motor.size, motor.spacing)
    radius[nodes] = found.radius
    models = replace(found, radius=radius, coefficients=coefficients)
    return Predictor(motor, candidate.smooth, models)
