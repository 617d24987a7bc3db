"""Settling: a model of maps that followed a stream, with the links and local models of its rows."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..body.belief import Body
from ..body.body_fit import BodyFit, fit
from ..body.rows import Rows as Measured
from ..common.arrays import Array
from ..common.rows import row_lengths
from ..errors import CalibError
from ..maps.association import Association
from ..maps.links import SparseRows, Wiring
from ..maps.local_models import NO_MODELS
from ..maps.map import Map
from ..maps.model_selection import blocks, select
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import MeasuredRows
from ..model.model import Model
from ..training.bounds import node_bounds


@dataclass(frozen=True)
class SettleSettings:
    """What a settled model rests on."""

    # samples that links are learned from where the stream is short
    imagined: int = 20_000
    # most rows that a body is refitted to: more hardly change it
    rows: int = 3000
    # rows below which a stream gets no new links
    few_rows: int = 1000


SETTLE = SettleSettings()


def settled_model(
    model: Model,
    motor: Map,
    sensory: Map,
    q: Array,
    x: Array,
    links: SparseRows | None,
) -> Model:
    """A model with maps as they are now, which have followed some samples.

    q, x : (n, dof), (n, m) [unit], samples since the change
    links : (motor, sensory), links as they are; where they are None, those at which eq. 11 comes to
        rest for the samples
    """
    scale = motor.scale
    wiring = model.association.wiring
    # a short stream may have been shown again and again
    _, first = np.unique(np.hstack([q, x]), axis=0, return_index=True)
    first = np.sort(first)
    u = scale.to_unit(q[first])
    x = x[first]

    body, predictor, judged, errors = _readout(model, motor, sensory, u, x)
    local = NO_MODELS
    if predictor is not None:
        local = predictor.models
    if links is None:
        association = _association(model, motor, sensory, u, x, predictor)
    else:
        association = Association(motor, sensory, links, wiring)
    rows = None
    if model.rows is not None:
        rows = MeasuredRows.of(scale.from_unit(u), x)
    settled = replace(
        model,
        association=association,
        local=local,
        body=body,
        visited=motor.visited_by(u),
        rows=rows,
    )
    reading, position = node_bounds(settled, judged, errors)
    if model.about.bound_of == "true position":
        reading = position
    return replace(settled, bounds=reading, model_bounds=position)


def _readout(
    model: Model, motor: Map, sensory: Map, u: Array, x: Array
) -> tuple[Body | None, Predictor | None, Array, Array]:
    """Body and readout of samples (n, dof), (n, m), where it was judged (k, dof), errors (k,)."""
    fitted = slice(None, None, -(-len(u) // SETTLE.rows))
    judged = u[fitted]
    body_fit = _refitted(model, motor.scale.from_unit(judged), x[fitted])
    if body_fit is None:
        wiring = model.association.wiring
        errors = _errors_of_links(motor, sensory, wiring, u, x)
        return None, None, u, errors
    smooth = BodyInBox(body_fit.body, motor.scale)
    held_out = body_fit.held_out
    predictor, residual = select(motor, judged, x[fitted], smooth, held_out)
    errors = row_lengths(residual)
    return body_fit.body, predictor, judged, errors


def _association(
    model: Model,
    motor: Map,
    sensory: Map,
    u: Array,
    x: Array,
    predictor: Predictor | None,
) -> Association:
    """Maps with the links of samples (n, dof), (n, m), or where these are few of predictions."""
    wiring = model.association.wiring
    if predictor is None or len(u) >= SETTLE.few_rows:
        return _learned(motor, sensory, wiring, u, x)
    shape = (SETTLE.imagined, u.shape[1])
    drawn = np.random.default_rng(model.about.seed).random(shape)
    positions = predictor.value(drawn)
    return _learned(motor, sensory, wiring, drawn, positions)


def _learned(
    motor: Map, sensory: Map, wiring: Wiring, u: Array, x: Array
) -> Association:
    """Links at which eq. 11 comes to rest, of (n, dof) in the unit box and (n, m) [unit]."""
    return Association.learn(
        motor, u, sensory, sensory.scale.to_unit(x), wiring
    )


def _refitted(model: Model, q: Array, x: Array) -> BodyFit | None:
    """The model's body fitted to samples, None without one or of rows that are too few or close."""
    if model.body is None:
        return None
    with suppress(CalibError):
        rows = [Measured(q, x)]
        return fit(model.body.structure, rows, seed=model.about.seed)
    return None


def _errors_of_links(
    motor: Map, sensory: Map, wiring: Wiring, u: Array, x: Array
) -> Array:
    """Errors (n,) [unit] of maps and links alone, each half of the blocks by the other's links."""
    folds = blocks(len(u))
    even = np.concatenate(folds[::2])
    odd = np.concatenate(folds[1::2])
    errors = np.empty(len(u))
    for held_out, shown in ((even, odd), (odd, even)):
        learned = _learned(motor, sensory, wiring, u[shown], x[shown])
        residual = learned.linear.value(u[held_out]) - x[held_out]
        errors[held_out] = row_lengths(residual)
    return errors
