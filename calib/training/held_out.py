"""Errors of a log's model on contiguous blocks of rows that it has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..common.scale import Scale
from ..maps.association import MAP_READOUTS, Association
from ..maps.local_models import NO_MODELS
from ..maps.model_selection import Selected
from ..maps.predictor import Predictor
from ..model.model import Model
from ..samples.samples import Samples
from .evaluate import Residuals
from .imagined import with_imagined
from .learn import Options, Stopwatch, both_maps, link
from .smooth import SmoothPart, wrong_around

Array = NDArray[np.float64]

_TESTED = 5_000  # rows that errors are measured on; more would tell no more
_HALVES = 2  # the maps' readouts are tested on blocks that the other half did not show


def held_out_residuals(
    model: Model, samples: Samples, part: SmoothPart, selected: Selected, options: Options
) -> Residuals:
    """Residuals of all readouts on rows that were held out in contiguous blocks.

    The default readout and the body are held out in ten blocks; the readouts of the maps
    are those of maps that have learned from every other block.

    Parameters
    ----------
    model : Model
        Learned from all rows.
    samples : Samples
        The log.
    part : SmoothPart
        Smooth parts with their held-out residuals.
    selected : Selected
        The predictor's held-out residuals.
    options : Options
        How the maps learn.
    """
    every = max(1, len(selected.rows) // _TESTED)
    rows = selected.rows[::every]
    q, x = samples.q[part.rows][rows], samples.x[part.rows][rows]
    forward = {"local": -selected.residual[::every]}
    if part.fit is not None and model.body is not None:
        forward["body"] = -part.fit.held_out[rows]
    inverse: dict[str, Array] = {}
    distance: dict[str, Array] = {}
    for readout, error in list(forward.items()):
        inverse[readout], distance[readout] = _answered(model, q, error)
    for readout in MAP_READOUTS:
        forward[readout], inverse[readout] = np.empty_like(x), np.empty_like(q)
        distance[readout] = np.empty(len(q))
    for chosen, seen in _halves(len(samples), part.rows[rows]):
        other = _maps_of(model, samples, part, seen, options)
        _add_maps(model, other, q, x, chosen, forward, inverse, distance)
    return Residuals(q, x, forward, inverse, distance, samples.joint_names, 0)


def linear_selected(
    association: Association, samples: Samples, part: SmoothPart, options: Options
) -> Selected:
    """The predictor that maps and links are by themselves, with its held-out residuals.

    Parameters
    ----------
    association : Association
        Learned from all rows.
    samples : Samples
    part : SmoothPart
        Without candidates.
    options : Options
        How the maps learn.
    """
    predictor = Predictor(association.motor, association.linear, NO_MODELS)
    rows = np.arange(0, len(part.rows), max(1, len(part.rows) // _TESTED))
    residual = np.zeros((len(rows), samples.x.shape[1]))
    if samples.simulation is not None:  # fresh samples tell more
        return Selected(predictor, rows, residual)
    scale = association.motor.scale
    u = scale.to_unit(samples.q[part.rows][rows])
    x = samples.x[part.rows][rows]
    for chosen, seen in _halves(len(samples), part.rows[rows]):
        other = _linked(scale, samples, part, seen, options)
        residual[chosen] = x[chosen] - other.linear.value(u[chosen])
    return Selected(predictor, rows, residual)


def _halves(n: int, rows: NDArray[np.intp]) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Which of `rows` are unseen, and the rows that are seen, for every other block each."""
    folds = np.array_split(np.arange(n), 2 * _HALVES * 5)
    for half in range(_HALVES):
        unseen = np.concatenate(folds[half::_HALVES])
        chosen = np.flatnonzero(np.isin(rows, unseen))
        if len(chosen):
            yield chosen, np.setdiff1d(np.arange(n), unseen, assume_unique=True)


def _answered(model: Model, q: Array, error: Array) -> tuple[Array, Array]:
    """Joint errors (n, dof) and displacements (n,) of answers to targets that are off.

    A target that a held-out prediction misses by `error` is answered by the joints that the
    learned map leads there; the displacement is from where it leads from the true joints.
    """
    here = model.predictor.value(model.motor.scale.to_unit(q))
    near = model.motor.scale.from_unit(model.solver.clip(model.motor.scale.to_unit(q)))
    answer = model.solve(here - error, near)
    scale = model.motor.scale
    gap = scale.difference(scale.to_unit(answer.q), scale.to_unit(q)) * scale.span
    there = model.predictor.value(scale.to_unit(answer.q))
    return gap, np.linalg.norm(there - here, axis=1)


def _maps_of(
    model: Model, samples: Samples, part: SmoothPart, seen: NDArray[np.intp], options: Options
) -> Model:
    """The model with maps and links that have learned from some of the rows."""
    return replace(model, association=_linked(model.motor.scale, samples, part, seen, options))


def _linked(
    scale: Scale, samples: Samples, part: SmoothPart, seen: NDArray[np.intp], options: Options
) -> Association:
    """Maps and links that have learned from some of the rows."""
    u, x = with_imagined(scale.to_unit(samples.q[seen]), samples.x[seen], part, options)
    wrong = wrong_around(part, scale, samples, u)
    motor, sensory = both_maps(scale, u, x, options, Stopwatch(), None, wrong)
    return link(motor, sensory, u, x, options)


def _add_maps(
    model: Model,
    other: Model,
    q: Array,
    x: Array,
    chosen: NDArray[np.intp],
    forward: dict[str, Array],
    inverse: dict[str, Array],
    distance: dict[str, Array],
) -> None:
    """Fill in the residuals of the maps' readouts for the rows `chosen`."""
    scale, sensory = model.motor.scale, other.sensory
    u = scale.to_unit(q[chosen])
    here = model.predictor.value(u)
    near = model.solver.clip(u)
    for readout in MAP_READOUTS:
        predicted = sensory.scale.from_unit(other.association.forward(u, readout))
        forward[readout][chosen] = predicted - x[chosen]
        v = sensory.scale.to_unit(x[chosen])
        answer = model.solver.clip(other.association.inverse(v, near, readout))
        inverse[readout][chosen] = scale.difference(answer, u) * scale.span
        moved = model.predictor.value(answer) - here
        distance[readout][chosen] = np.linalg.norm(moved, axis=1)
