"""Cross-validation: how smooth the trend and how wide the local models should be.

Folds are contiguous blocks of rows, because neighbouring rows of a real log can be
near-repeats that would flatter a model split row by row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.basis import exponents
from ..body.trend import Trend
from ..body.trend_choice import TrendChoice, choose_trends
from ..common.scale import Scale
from . import local_models as local
from .local_models import NO_MODELS, LocalModels, Neighbourhood
from .map import Map
from .predictor import Predictor

Array = NDArray[np.float64]

FOLDS = 10
_ROUNDING = 1e-9  # share of the extent that is no improvement
_PRICE = 5e-4  # share of the error by which one more function of a trend must mend it
_HELD_OUT = 1000  # rows on which local models are compared
_CANDIDATES = ((0, 30), (1, 50), (1, 200), (2, 24), (2, 60), (3, 40))


@dataclass(frozen=True)
class Selected:
    """A predictor and what cross-validation found of it.

    Attributes
    ----------
    predictor : Predictor
        Fitted to all samples.
    rows : (m,) int array
        Rows that were held out in turn.
    errors : (m,) array
        Distance between their positions and what a predictor said that had not seen them.
    """

    predictor: Predictor
    rows: NDArray[np.intp]
    errors: Array


def blocks(n: int, folds: int = FOLDS) -> list[NDArray[np.intp]]:
    """Contiguous blocks of the rows 0 ... n - 1."""
    return np.array_split(np.arange(n), min(folds, n))


def select(
    motor: Map, turning: tuple[bool, ...], u: Array, x: Array, trend: Trend | None = None
) -> Selected:
    """Fit trend and local models whose complexity cross-validation prefers.

    Parameters
    ----------
    motor : Map
        Nodes that will carry the local models.
    turning : tuple of bool
        Joints that turn, rather than slide.
    u, x : (n, d), (n, 2) array
        Samples: joints in the unit box, positions.
    trend : Trend, optional
        Where the samples are a teacher's imagination its own trend: they are without
        noise, so that a wilder one would fit, and run away beyond them.

    Returns
    -------
    Selected
    """
    folds = blocks(len(u))
    choices = [TrendChoice(trend, [trend] * len(folds))] if trend is not None else None
    best: tuple[TrendChoice, tuple[int, int] | None, NDArray[np.intp], Array] | None = None
    for choice in choices or choose_trends(motor.scale, turning, u, x, folds):
        shape, rows, errors = _compare(motor, u, x, folds, choice.without)
        if best is None or outdoes(errors, best[3], choice.trend.terms - best[0].trend.terms):
            best = (choice, shape, rows, errors)
    assert best is not None  # noqa: S101
    choice, shape, rows, errors = best
    models = NO_MODELS
    if shape is not None:
        residual = x - choice.trend.value(u)
        models = local.fit(motor.units, u, residual, motor.scale, *shape)
    return Selected(Predictor(motor, choice.trend, models), rows, errors)


def outdoes(errors: Array, simpler: Array, extra: int) -> bool:
    """Whether the held-out errors of a trend are worth its `extra` functions.

    Noise hides how far a simpler trend is off, so it is not favoured beyond their price.
    """
    return bool(errors.mean() * (1.0 + _PRICE * extra) < simpler.mean())


def better(errors: Array, others: Array, least: float = 0.0) -> bool:
    """Whether paired held-out errors are smaller by more than chance and than `least`."""
    gain = others - errors
    chance = 2.0 * float(gain.std()) / np.sqrt(len(gain))
    return bool(gain.mean() > max(chance, least, 0.03 * float(others.mean())))


def _compare(
    motor: Map,
    u: Array,
    x: Array,
    folds: list[NDArray[np.intp]],
    without: list[Trend],
) -> tuple[tuple[int, int] | None, NDArray[np.intp], Array]:
    """Best (degree, samples) of the local models, None for no correction at all.

    Each fold is held out in turn (a few of them where samples abound); only the nodes that
    speak for its rows are fitted.
    """
    use = range(len(folds)) if len(u) <= 5 * _HELD_OUT else range(0, len(folds), 3)
    quota = max(1, _HELD_OUT // len(use))
    size = local.blend_size(u.shape[1])
    candidates = [
        c for c in _CANDIDATES if 1.2 * len(exponents(u.shape[1], c[0])) <= c[1] < len(u) // 4
    ]
    held = [folds[fold][:: max(1, len(folds[fold]) // quota)] for fold in use]
    left = [x[rows] - without[fold].value(u[rows]) for fold, rows in zip(use, held, strict=True)]
    errors = np.linalg.norm(np.concatenate(left), axis=1)
    least = _ROUNDING * float(np.linalg.norm(np.ptp(x, axis=0)))
    if errors.mean() <= least:  # nothing is left to mend
        return None, np.concatenate(held), errors
    found: dict[tuple[int, int], list[Array]] = {c: [] for c in candidates}
    for fold, rows, target in zip(use if candidates else (), held, left, strict=False):
        others = np.setdiff1d(np.arange(len(u)), folds[fold], assume_unique=True)
        residual = x[others] - without[fold].value(u[others])
        index, weight = local.blend(motor, u[rows], size)
        nodes, place = np.unique(index, return_inverse=True)
        most = max(k for _, k in candidates)
        around = Neighbourhood.of(motor.units[nodes], u[others], motor.scale, most)
        for degree, k in candidates:
            models = local.fit(
                motor.units[nodes], u[others], residual, motor.scale, degree, k, around
            )
            said = _blended(models, motor, u[rows], index, place.reshape(index.shape), weight)
            found[degree, k].append(np.linalg.norm(target - said, axis=1))
    choice: tuple[int, int] | None = None
    for c, parts in found.items():
        tried = np.concatenate(parts)
        if better(tried, errors, least):
            choice, errors = c, tried
    return choice, np.concatenate(held), errors


def _blended(
    models: LocalModels,
    motor: Map,
    u: Array,
    index: NDArray[np.intp],
    place: NDArray[np.intp],
    weight: Array,
) -> Array:
    """What the local models of some nodes say, blended; `place` finds them in `models`."""
    scale: Scale = motor.scale
    z = scale.difference(u[:, None], motor.units[index]) / models.radius[place][..., None]
    c = models.coefficients[place] * weight[..., None, None]
    value: Array = np.einsum("nmt,nmto->no", local.monomials(z, models.degree), c)
    return value
