"""The model that maps settle to which have followed a stream: links at rest and local models.

What leads from joints to positions is learned anew from the rows since the change.  With a body the
changed arm is a body again, so that a few rows speak for the whole range; without one maps and
links stand alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..body.fitting import BodyFit, fit
from ..common.arrays import Array, Index
from ..errors import CalibError
from ..maps.association import Association
from ..maps.local_models import NO_MODELS
from ..maps.map import Map
from ..maps.model_selection import blocks, select
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import Rows
from ..model.model import Model
from ..training.bounds import node_bounds

if TYPE_CHECKING:
    from scipy.sparse import csr_array


_IMAGINED = 20_000  # samples that links are learned from where the stream is short
_ROWS = 3000  # rows that a body is refitted to: more would tell it hardly more
_FEW_ROWS = 1000  # fewer have no links of their own


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
    every, wiring = -(-len(u) // _ROWS), model.association.wiring
    found, seen = _body_of(model, motor.scale.from_unit(u[::every]), x[::every]), (u, x)
    if found is not None:
        smooth = BodyInBox(found.body, motor.scale)
        predictor, left = select(motor, u[::every], x[::every], smooth, found.held_out)
        rows, errors = np.arange(len(u))[::every], np.linalg.norm(left, axis=1)
        if len(u) < _FEW_ROWS:
            drawn = np.random.default_rng(model.about.seed).random((_IMAGINED, u.shape[1]))
            seen = drawn, predictor.value(drawn)
    if links is not None:
        association = Association(motor, sensory, links, wiring)
    else:
        v = sensory.scale.to_unit(seen[1])
        association = Association.learn(motor, seen[0], sensory, v, wiring)
    if found is None:  # maps and links, without anything else
        predictor = Predictor(motor, association.linear, NO_MODELS)
        rows, errors = _held_out(association, u, x)
    made = replace(
        model,
        association=association,
        predictor=predictor,
        body=None if found is None else found.body,
        visited=np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0,
        rows=Rows.of(motor.scale.from_unit(u), x) if model.rows is not None else None,
    )
    reading, position = node_bounds(made, u[rows], errors)
    true = model.about.bound_of == "true position"
    return replace(made, bounds=position if true else reading, model_bounds=position)


def _body_of(model: Model, q: Array, x: Array) -> BodyFit | None:
    """A body of rows (n, dof) and (n, m), None where none can be fitted to them."""
    if model.body is None:
        return None
    try:
        return fit(
            model.body.structure, q, x, simulated=model.body.simulated, seed=model.about.seed
        )
    except CalibError:  # too few rows, or too close to each other
        return None


def _held_out(association: Association, u: Array, x: Array) -> tuple[Index, Array]:
    """Rows, and errors (n,) [unit] of the readout ``linear`` on them, from every other block."""
    motor, sensory, wiring = association.motor, association.sensory, association.wiring
    folds, errors = blocks(len(u)), np.empty(len(u))
    for half in (0, 1):
        held, seen = (np.concatenate(folds[k::2]) for k in (half, 1 - half))
        other = Association.learn(motor, u[seen], sensory, sensory.scale.to_unit(x[seen]), wiring)
        errors[held] = np.linalg.norm(other.linear.value(u[held]) - x[held], axis=1)
    return np.arange(len(u)), errors
