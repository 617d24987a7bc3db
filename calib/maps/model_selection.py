"""Cross-validation: how smooth the trend and how wide the local models should be.

Folds are contiguous blocks of rows, because neighbouring rows of a real log can be
near-repeats that would flatter a model split row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.basis import exponents
from ..body.posterior import BodyFit
from ..body.trend_choice import choose_trends
from ..common.arrays import Array, Index
from ..common.scale import Scale
from . import local_models as local
from .map import Map
from .misfit import misfit
from .node_choice import NodeChoice, Shape, fit_each, held_out
from .predictor import BodyInBox, Both, Predictor, Smooth

FOLDS = 10
_ROUNDING = 1e-9  # share of the extent that is no improvement
_PRICE = 5e-4  # share of the error by which one more function of a trend must mend it
_HELD_OUT = 1000  # rows on which local models are compared
_MENDED = 0.5  # share of a smooth part's error that local models leave where it is no chain's
_CALM = 0.2  # share of the rows that is enough to choose what serves the calm ones
_CANDIDATES: tuple[Shape, ...] = ((0, 30), (1, 50), (1, 200), (2, 24), (2, 60), (3, 40), (5, 60))


@dataclass(frozen=True)
class SmoothCandidate:
    """A smooth part, with what it leaves over of rows that it has and has not seen."""

    smooth: Smooth  # fitted to all samples
    residual: Array  # (n, m), positions less its predictions
    # sequence of (n, m) arrays, for each fold the residuals of a smooth part that has not seen the
    # fold's rows
    unseen: Sequence[Array]
    # share of a better founded candidate's error that it has to reach with its local models; it is
    # tried where they mend much of the other
    rival: float = 1.0

    @property
    def held_out(self) -> Array:
        """Residuals (n, m) of all rows, each from a smooth part that has not seen its fold."""
        folds = blocks(len(self.residual))
        return np.concatenate([p[f] for p, f in zip(self.unseen, folds, strict=True)])


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
    residual = x - smooth.value(u)
    unseen = []
    for rows in blocks(len(u)):
        part = residual.copy()
        part[rows] = fit.held_out[rows]
        unseen.append(part)
    return SmoothCandidate(smooth, residual, unseen)


def of_trends(
    scale: Scale,
    turning: tuple[bool, ...],
    u: Array,
    x: Array,
    under: SmoothCandidate | None = None,
) -> list[SmoothCandidate]:
    """The trends that cross-validation compares, simplest first.

    scale : range of the joints
    turning : joints that turn, rather than slide
    u, x : (n, dof), (n, m), joints in the unit box and positions
    under : a smooth part; the trends are then of what it leaves over
    """
    folds = blocks(len(u))
    target = x if under is None else under.residual
    found = []
    for choice in choose_trends(scale, turning, u, target, folds):
        residual = target - choice.trend.value(u)
        unseen = []
        for k, trend in enumerate(choice.without):
            base = target if under is None else under.unseen[k]
            unseen.append(base - trend.value(u))
        smooth = choice.trend if under is None else Both(under.smooth, choice.trend)
        found.append(SmoothCandidate(smooth, residual, unseen))
    return found


def select(motor: Map, u: Array, candidates: Sequence[SmoothCandidate]) -> Selected:
    """Choose the smooth part, and fit local models whose complexity cross-validation prefers.

    motor : nodes that will carry the local models
    u : (n, dof), joints of the samples, in the unit box
    candidates : smooth parts, the simplest first
    """
    folds = blocks(len(u))
    best: tuple[SmoothCandidate, _Chosen, Array] | None = None
    for candidate in candidates:
        if candidate.rival < 1.0 and best is not None:
            smooth = np.linalg.norm(best[0].held_out[best[1].rows], axis=1)
            if best[2].mean() > _MENDED * smooth.mean():
                continue
        chosen = _compare(motor, u, folds, candidate)
        errors = np.linalg.norm(chosen.residual, axis=1)
        if best is None or outdoes(
            errors, candidate.rival * best[2], candidate.smooth.terms - best[0].smooth.terms
        ):
            best = (candidate, chosen, errors)
    assert best is not None  # noqa: S101
    candidate, chosen, _ = best
    shapes, nodes = chosen.shapes, chosen.nodes
    models = fit_each(motor, u, candidate.residual, shapes, nodes, chosen.gates)
    return Selected(Predictor(motor, candidate.smooth, models), chosen.rows, chosen.residual)


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


@dataclass(frozen=True, eq=False)
class _Chosen:
    """Local models that serve a smooth part best, and what remained of rows while held out."""

    rows: Index
    residual: Array
    shapes: Sequence[Shape]
    nodes: Index  # (nodes,), which of the shapes each node has, -1 for none
    gates: Array | None = None


def _compare(motor: Map, u: Array, folds: list[Index], candidate: SmoothCandidate) -> _Chosen:
    """Best (degree, samples) of the local models, None for no correction at all.

    Each fold is held out in turn (a few of them where samples abound); only the nodes that
    speak for its rows are fitted.  Rows at which the smooth part is wrong by more than the
    others are left to the nodes that speak for them.
    """
    use = range(len(folds)) if len(u) <= 5 * _HELD_OUT else range(0, len(folds), 3)
    quota = max(1, _HELD_OUT // len(use))
    shapes = [
        c for c in _CANDIDATES if 1.2 * len(exponents(u.shape[1], c[0])) <= c[1] < len(u) // 4
    ]
    held = [folds[fold][:: max(1, len(folds[fold]) // quota)] for fold in use]
    rows = np.concatenate(held)
    best = candidate.held_out[rows]
    errors = np.linalg.norm(best, axis=1)
    x = candidate.smooth.value(u[:: max(1, len(u) // 100)])
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    least = _ROUNDING * extent
    if errors.mean() <= least or not shapes:  # nothing is left to mend
        return _Chosen(rows, best, shapes, np.full(motor.size, -1))
    around = misfit(motor.scale, u, candidate.held_out, extent, u)
    wrong = np.zeros(len(u), dtype=bool) if around is None else around > 0.0
    index, weight, gap = local.speaking(motor, u[rows])
    unseen, used = [candidate.unseen[fold] for fold in use], [folds[fold] for fold in use]
    every = np.arange(motor.size)
    predicted = held_out(motor, every, u, unseen, used, rows, index, gap, shapes)[1:]
    smooth, common = best, -1
    calm = ~wrong[rows]
    if np.count_nonzero(calm) < _CALM * len(rows):
        calm[:] = True  # no part of the samples is calm
    for k, each in enumerate(predicted):
        tried = smooth - np.einsum("nm,nmo->no", weight, each)
        tried_errors = np.linalg.norm(tried, axis=1)
        if better(tried_errors[calm], errors[calm], least):
            common, best, errors = k, tried, tried_errors
    if not wrong.any():
        return _Chosen(rows, best, shapes, np.full(motor.size, common))
    own = NodeChoice.of(motor, u, candidate.unseen, folds, wrong, shapes, common)
    return _Chosen(rows, own.remaining(rows, best), shapes, own.shape, own.gates)
