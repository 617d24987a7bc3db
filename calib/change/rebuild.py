"""Rebuilding: a model round another body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array
from ..common.scale import Scale
from ..maps import local_models
from ..maps.local_models import NO_MODELS, exponents
from ..maps.map import Map
from ..maps.predictor import BodyInBox, Predictor
from ..model.alignment import Alignment
from ..model.model import Model
from .frame import carried_offset

_PER_NODE = 5  # drawn joints that what maps add to a body is learned from
# of local models where there were none
_DEGREE = 2
_SAMPLES = 20
_NOTHING = 1e-9  # of the extent: less is nothing to keep


def rebuilt(model: Model, old: Body, body: Body, u: Array) -> Model:
    """The model with an updated body, maps that follow it, and new bounds.

    old : the body that maps were learned beside
    u : (n, dof), joints in the unit box of the rows of the update
    """
    motor = model.motor
    nodes = np.clip(model.motor.units, 0.0, 1.0)
    drawn = np.random.default_rng(0).random(
        (_PER_NODE * motor.size, nodes.shape[1])
    )
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
        visited=model.visited
        | (np.bincount(winners, minlength=motor.size) > 0),
    )


def _moved(model: Model, before: Array, after: Array) -> Map:
    """The sensory map, each node moved by the mean of the motor nodes that it is linked with.

    before, after : (motor nodes, m) [unit], what was and what is predicted at the motor nodes
    """
    old = model.sensory
    links = model.links
    total = np.asarray(links.sum(axis=0)).ravel()
    here, there = (
        links.T @ x / np.maximum(total, 1e-300)[:, None]
        for x in (before, after)
    )
    # an affine map of the means, so that what a node differs from its partners is mapped too
    frame = Alignment.between(before, after)
    known = total > 0
    moved = frame.apply(old.weights)
    moved[known] += (there - frame.apply(here))[known]
    scale = Scale.of_data(np.concatenate([moved, after]))
    return Map(scale.to_unit(moved), old.lattice, scale, old.history)
