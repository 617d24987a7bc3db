"""Rebuilding: the model of an updated belief, its maps carried along, its bounds made anew.

No map is trained again.  Each sensory node moves as far as the motor nodes it is linked with say;
what local models add to the body moves with the tip.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array
from ..common.scale import Scale
from ..maps import local_models
from ..maps.association import Association
from ..maps.linear_models import from_shifts, to_shifts
from ..maps.local_models import NO_MODELS, exponents
from ..maps.map import Map
from ..maps.predictor import BodyInBox, Predictor
from ..model.alignment import Alignment
from ..model.model import Model
from .comparison import Comparison
from .frame import carried_offset

_PER_NODE = 5
_DEGREE, _SAMPLES = 2, 20  # of local models where there were none
_NOTHING = 1e-9  # of the extent: less is nothing to keep


def rebuilt(found: Comparison, body: Body) -> Model:
    """The model with the updated body, maps that follow it, and new bounds."""
    model, motor, old = found.model, found.model.motor, found.model.association
    nodes = np.clip(motor.units, 0.0, 1.0)
    drawn = np.random.default_rng(0).random((_PER_NODE * motor.size, nodes.shape[1]))
    u = np.concatenate([nodes, drawn])
    q = motor.scale.from_unit(u)
    before = model.predictor.value(u)
    added = before - found.body.predict(q)
    if np.any(added):
        added = carried_offset(found.body, body, body.beta, q, added)
    smooth, extent = BodyInBox(body, motor.scale), float(np.linalg.norm(np.ptp(before, axis=0)))
    models = NO_MODELS
    if float(np.abs(added).max()) > _NOTHING * extent:
        degree = max(model.predictor.models.degree, _DEGREE)
        samples = max(_SAMPLES, 2 * len(exponents(u.shape[1], degree)))
        models = local_models.fit(motor, np.arange(motor.size), u, added, (degree, samples))
    predictor = Predictor(motor, smooth, models)
    sensory = _moved(model, before[: len(nodes)], predictor.value(nodes))
    means = old.sensory_means
    if means is not None:  # as many spacings from the nodes as before
        means = from_shifts(sensory, to_shifts(old.sensory, means).astype(float))
    reading, position = (body.bound(q[: len(nodes)], noise=noise) for noise in (True, False))
    winners = motor.nearest(found.u)[1][:, 0]
    return replace(
        model,
        association=Association(motor, sensory, model.links, old.wiring, old.motor_means, means),
        predictor=predictor,
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
    old, links = model.sensory, model.links
    total = np.asarray(links.sum(axis=0)).ravel()
    here, there = (links.T @ x / np.maximum(total, 1e-300)[:, None] for x in (before, after))
    # an affine map of the means, so that what a node differs from its partners is mapped too
    frame, known = Alignment.between(before, after), total > 0
    moved = frame.apply(old.weights)
    moved[known] += (there - frame.apply(here))[known]
    scale = Scale.of_data(np.concatenate([moved, after]))
    return Map(scale.to_unit(moved), old.lattice, scale, old.history)
