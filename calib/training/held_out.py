"""Errors of a log's model on contiguous blocks of rows that it has not seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.choices import MAP_READOUTS
from ..common.scale import Scale
from ..maps.association import Association
from ..maps.model_selection import Selected
from ..model.model import Model
from ..samples.samples import Samples
from .evaluate import Residuals
from .learn import Options, Stopwatch, both_maps, link
from .smooth import SmoothPart, with_imagined, wrong_around

_TESTED = 5_000  # rows that errors are measured on; more would tell no more
_HALVES = 2  # the maps' readouts are tested on blocks that the other half did not show


def held_out_residuals(
    model: Model, samples: Samples, part: SmoothPart, selected: Selected | None, options: Options
) -> Residuals:
    """Residuals of all readouts on rows that were held out in contiguous blocks.

    The default readout and the body are held out in ten blocks; the readouts of the maps
    are those of maps that have learned from every other block.

    model : learned from all rows
    samples : the log
    part : smooth parts with their held-out residuals
    selected : the predictor's held-out residuals; None where maps and links stand alone
    options : how the maps learn
    """
    forward: dict[str, Array] = {}
    if selected is None:
        rows = tested_rows(part)
    else:
        every = max(1, len(selected.rows) // _TESTED)
        rows = selected.rows[::every]
        forward["local"] = -selected.residual[::every]
    q, x = samples.q[part.rows][rows], samples.x[part.rows][rows]
    if part.fit is not None and "body" in model.readouts:
        forward["body"] = -part.fit.held_out[rows]
    inverse: dict[str, Array] = {}
    distance: dict[str, Array] = {}
    for readout, error in list(forward.items()):
        inverse[readout], distance[readout] = _answered(model, q, error)
    for readout in MAP_READOUTS:
        forward[readout], inverse[readout] = np.empty_like(x), np.empty_like(q)
        distance[readout] = np.empty(len(q))
    scale = model.motor.scale
    folds = np.array_split(np.arange(len(samples)), 2 * _HALVES * 5)
    for half in range(_HALVES):
        unseen = np.concatenate(folds[half::_HALVES])
        chosen = np.flatnonzero(np.isin(part.rows[rows], unseen))
        if not len(chosen):
            continue
        seen = np.setdiff1d(np.arange(len(samples)), unseen, assume_unique=True)
        pair = _maps_of(scale, samples, part, seen, options)
        u = scale.to_unit(q[chosen])
        here, near = model.predictor.value(u), model.solver.clip(u)
        answers = pair.inverses(pair.sensory.scale.to_unit(x[chosen]), near, MAP_READOUTS)
        for readout in MAP_READOUTS:
            predicted = pair.sensory.scale.from_unit(pair.forward(u, readout))
            forward[readout][chosen] = predicted - x[chosen]
            answer = model.solver.clip(answers[readout])
            inverse[readout][chosen] = scale.difference(answer, u) * scale.span
            moved = model.predictor.value(answer) - here
            distance[readout][chosen] = np.linalg.norm(moved, axis=1)
    return Residuals(q, x, forward, inverse, distance, samples.joint_names, 0)


def tested_rows(part: SmoothPart) -> NDArray[np.intp]:
    """Rows of the smooth part that errors are measured on, evenly spread over the log."""
    return np.arange(0, len(part.rows), max(1, len(part.rows) // _TESTED))


def turned_of(part: SmoothPart) -> Array | None:
    """Held-out errors of orientation (k,) [rad] of those rows, None where it was not measured."""
    if part.fit is None or part.fit.turned is None:
        return None
    return part.fit.turned[tested_rows(part)]


def _answered(model: Model, q: Array, error: Array) -> tuple[Array, Array]:
    """Joint errors (n, dof) and displacements (n,) of answers to targets that are off.

    A target that a held-out prediction misses by `error` is answered by the joints that the
    learned map leads there; the displacement is from where it leads from the true joints.
    """
    scale = model.motor.scale
    u = scale.to_unit(q)
    here = model.predictor.value(u)
    answer = model.solve(here - error, scale.from_unit(model.solver.clip(u)))
    gap = scale.difference(scale.to_unit(answer.q), u) * scale.span
    there = model.predictor.value(scale.to_unit(answer.q))
    return gap, np.linalg.norm(there - here, axis=1)


def _maps_of(
    scale: Scale, samples: Samples, part: SmoothPart, seen: NDArray[np.intp], options: Options
) -> Association:
    """Maps and links that have learned from some of the rows."""
    u, x = with_imagined(scale.to_unit(samples.q[seen]), samples.x[seen], part, options)
    wrong = wrong_around(part, scale, samples, u)
    return link(*both_maps(scale, u, x, options, Stopwatch(), None, wrong), u, x, options)
