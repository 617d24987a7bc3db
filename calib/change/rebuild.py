"""Rebuilding: a model round another body, or round maps that followed a stream."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..body.body_fit import fit
from ..body.rows import Rows as Measured
from ..common.arrays import Array
from ..common.scale import Scale
from ..errors import CalibError
from ..maps import local_models
from ..maps.association import Association
from ..maps.links import Compressed
from ..maps.local_models import NO_MODELS, exponents
from ..maps.map import Map
from ..maps.model_selection import blocks, select
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import MeasuredRows
from ..model.alignment import Alignment
from ..model.model import Model
from ..training.bounds import node_bounds
from .frame import carried_offset

_PER_NODE = 5  # drawn joints that what maps add to a body is learned from
# of local models where there were none
_DEGREE = 2
_SAMPLES = 20
_NOTHING = 1e-9  # of the extent: less is nothing to keep
_IMAGINED = 20_000  # samples that links are learned from where the stream is short
_ROWS = 3000  # rows that a body is refitted to: more would tell it hardly more
_FEW_ROWS = 1000  # fewer have no links of their own


def rebuilt(model: Model, old: Body, body: Body, u: Array) -> Model:
    """The model with an updated body, maps that follow it, and new bounds.

    old : the body that maps were learned beside
    u : (n, dof), joints in the unit box of the rows of the update
    """
    motor = model.motor
    nodes = np.clip(model.motor.units, 0.0, 1.0)
    drawn = np.random.default_rng(0).random((_PER_NODE * motor.size, nodes.shape[1]))
    asked = np.concatenate([nodes, drawn])
    q = motor.scale.from_unit(asked)
    before = model.predictor.value(asked)
    added = before - old.predict(q)
    models = NO_MODELS
    if float(np.abs(added).max()) > _NOTHING * float(
        np.linalg.norm(np.ptp(before, axis=0))
    ):
        added = carried_offset(old, body, body.beta, q, added)
        degree = max(model.predictor.models.degree, _DEGREE)
        samples = max(_SAMPLES, 2 * len(exponents(asked.shape[1], degree)))
        models = local_models.fit(
            motor, np.arange(motor.size), asked, added, (degree, samples)
        )
    after = Predictor(motor, BodyInBox(body, motor.scale), models).value(nodes)
    sensory = _moved(model, before[: len(nodes)], after)
    reading, position = (
        body.bound(q[: len(nodes)], noise=noise) for noise in (True, False)
    )
    winners = motor.nearest(u)[1][:, 0]
    return replace(
        model,
        association=replace(model.association, motor=motor, sensory=sensory),
        local=models,
        body=body,
        rows=None,
        seconds={},
        bounds=reading,
        model_bounds=position,
        visited=model.visited | (np.bincount(winners, minlength=motor.size) > 0),
    )


def _moved(model: Model, before: Array, after: Array) -> Map:
    """The sensory map, each node moved by the mean of the motor nodes that it is linked with.

    before, after : (motor nodes, m) [unit], what was and what is predicted at the motor nodes
    """
    old = model.sensory
    links = model.links
    total = np.asarray(links.sum(axis=0)).ravel()
    here, there = (
        links.T @ x / np.maximum(total, 1e-300)[:, None] for x in (before, after)
    )
    # an affine map of the means, so that what a node differs from its partners is mapped too
    frame = Alignment.between(before, after)
    known = total > 0
    moved = frame.apply(old.weights)
    moved[known] += (there - frame.apply(here))[known]
    scale = Scale.of_data(np.concatenate([moved, after]))
    return Map(scale.to_unit(moved), old.lattice, scale, old.history)


def settled_model(
    model: Model,
    motor: Map,
    sensory: Map,
    q: Array,
    x: Array,
    links: Compressed | None = None,
) -> Model:
    """A model with maps as they are now, which have followed some samples.

    q, x : (n, dof), (n, m) [unit], samples since the change
    links : (motor, sensory), links as they are; by default those at which eq. 11 comes to rest for
        the samples.
    """
    scale = motor.scale
    wiring = model.association.wiring
    body = model.body
    found = None
    # a short stream may have been shown again and again
    first = np.sort(np.unique(np.hstack([q, x]), axis=0, return_index=True)[1])
    u = scale.to_unit(q[first])
    x = x[first]
    some = slice(None, None, -(-len(u) // _ROWS))
    if body is not None:
        with suppress(CalibError):  # too few rows, or too close to each other
            told = [Measured(scale.from_unit(u[some]), x[some])]
            found = fit(body.structure, told, seed=model.about.seed)

    def linked(u: Array, x: Array) -> Association:
        return Association.learn(motor, u, sensory, sensory.scale.to_unit(x), wiring)

    seen = (u, x)
    predictor = None
    if found is not None:
        smooth = BodyInBox(found.body, scale)
        predictor, left = select(motor, u[some], x[some], smooth, found.held_out)
        rows = np.arange(len(u))[some]
        errors = np.linalg.norm(left, axis=1)
        if len(u) < _FEW_ROWS:
            drawn = np.random.default_rng(model.about.seed).random(
                (_IMAGINED, u.shape[1])
            )
            seen = drawn, predictor.value(drawn)
    association = (
        linked(*seen) if links is None else Association(motor, sensory, links, wiring)
    )
    if predictor is None:  # maps and links alone, their errors from every other block
        folds = blocks(len(u))
        rows = np.arange(len(u))
        errors = np.empty(len(u))
        for half in (0, 1):
            held, shown = (np.concatenate(folds[k::2]) for k in (half, 1 - half))
            away = linked(u[shown], x[shown]).linear.value(u[held]) - x[held]
            errors[held] = np.linalg.norm(away, axis=1)
    made = replace(
        model,
        association=association,
        local=NO_MODELS if predictor is None else predictor.models,
        body=None if found is None else found.body,
        visited=np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0,
        rows=MeasuredRows.of(scale.from_unit(u), x) if model.rows is not None else None,
    )
    reading, position = node_bounds(made, u[rows], errors)
    true = model.about.bound_of == "true position"
    return replace(made, bounds=position if true else reading, model_bounds=position)
