"""The model that maps settle to which have followed a stream: links at rest and local models."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from ..maps.association import Association
from ..maps.local_models import NO_MODELS
from ..maps.map import Map
from ..maps.model_selection import blocks
from ..maps.predictor import Predictor
from ..model.rows import Rows
from ..training.log_bounds import node_bounds
from .refit import Refit, refit

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from ..model.model import Model


def settled_model(
    model: Model, motor: Map, sensory: Map, q: Array, x: Array, links: csr_array | None = None
) -> Model:
    """A model with maps that have followed some samples.

    model : as it was before
    motor, sensory : as they are now
    q, x : (n, dof), (n, m) [unit], samples since the change
    links : (motor, sensory) sparse array, links as they are; by default those at which eq. 11 comes
        to rest for the samples.
    """
    # a short stream may have been shown again and again
    first = np.sort(np.unique(np.hstack([q, x]), axis=0, return_index=True)[1])
    u, x = motor.scale.to_unit(q[first]), x[first]
    fitted = refit(model, motor, u, x)
    wiring = model.association.wiring
    if links is not None:
        association = Association(motor, sensory, links, wiring)
    else:
        v = sensory.scale.to_unit(fitted.v)
        association = Association.learn(motor, fitted.u, sensory, v, wiring)
    if model.default_readout == "linear":  # maps and links, without anything else
        fitted = _alone(fitted, association, u, x)
    made = replace(
        model,
        association=association,
        predictor=fitted.predictor,
        body=fitted.body,
        visited=np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0,
        rows=Rows.of(motor.scale.from_unit(u), x) if model.rows is not None else None,
    )
    has_models = fitted.predictor.models.degree >= 0
    reading, position = node_bounds(made, u, fitted.rows, fitted.errors, has_models=has_models)
    true = model.about.bound_of == "true position"
    return replace(made, bounds=position if true else reading, model_bounds=position)


def _alone(fitted: Refit, association: Association, u: Array, x: Array) -> Refit:
    """The readout ``linear`` in place of what was fitted, and its errors on unseen blocks."""
    motor, sensory, wiring = association.motor, association.sensory, association.wiring
    folds = blocks(len(u))
    errors, rows = [], []
    for half in (0, 1):
        held = np.concatenate(folds[half::2])
        seen = np.concatenate(folds[1 - half :: 2])
        other = Association.learn(motor, u[seen], sensory, sensory.scale.to_unit(x[seen]), wiring)
        errors.append(np.linalg.norm(other.linear.value(u[held]) - x[held], axis=1))
        rows.append(held)
    predictor = Predictor(motor, association.linear, NO_MODELS)
    return replace(
        fitted, predictor=predictor, rows=np.concatenate(rows), errors=np.concatenate(errors)
    )
