"""The model that maps settle to which have followed a stream: links at rest and local models.

What leads from joints to positions is learned anew from the rows since the change.  With a body the
changed arm is a body again, so that a few rows speak for the whole range; without one maps and
links stand alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body
from ..body.fitting import fit
from ..common.arrays import Array
from ..errors import CalibError
from ..maps.association import Association
from ..maps.local_models import NO_MODELS
from ..maps.map import Map
from ..maps.model_selection import blocks, of_body, select
from ..maps.predictor import Predictor
from ..model.measured import Rows
from ..model.model import Model
from ..training.held_out import node_bounds

if TYPE_CHECKING:
    from scipy.sparse import csr_array


IMAGINED = 20_000
"""Samples that a model imagines to learn its links from."""

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
    fitted = _with_body(model, motor, u, x)
    wiring = model.association.wiring
    if links is not None:
        association = Association(motor, sensory, links, wiring)
    else:
        seen_u, seen_x = (u, x) if fitted is None else (fitted.u, fitted.v)
        v = sensory.scale.to_unit(seen_x)
        association = Association.learn(motor, seen_u, sensory, v, wiring)
    fitted = fitted or _alone(association, u, x)  # maps and links, without anything else
    made = replace(
        model,
        association=association,
        predictor=fitted.predictor,
        body=fitted.body,
        visited=np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0,
        rows=Rows.of(motor.scale.from_unit(u), x) if model.rows is not None else None,
    )
    reading, position = node_bounds(made, u, fitted.rows, fitted.errors)
    true = model.about.bound_of == "true position"
    return replace(made, bounds=position if true else reading, model_bounds=position)


@dataclass(frozen=True, eq=False)
class _Refit:
    """What rows say of the way from joints to positions."""

    predictor: Predictor  # smooth part and local models
    body: Body | None  # the body under the local models, if there is one
    rows: NDArray[np.intp]  # (m,), rows that were held out in turn
    errors: Array  # (m,) [unit], their held-out errors
    # (k, dof), (k, n), samples from which links come to rest: joints in the unit box and positions
    u: Array
    v: Array


def _alone(association: Association, u: Array, x: Array) -> _Refit:
    """The readout ``linear`` and its errors on unseen blocks."""
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
    return _Refit(predictor, None, np.concatenate(rows), np.concatenate(errors), u, x)


def _with_body(model: Model, motor: Map, u: Array, x: Array) -> _Refit | None:
    """A body of the rows (n, dof, unit box) and (n, m), None where none can be fitted to them."""
    if model.body is None:
        return None
    scale, about, simulated = motor.scale, model.about, model.body.simulated
    every = -(-len(u) // _ROWS)
    seen = u, x
    u, x = u[::every], x[::every]
    try:
        found = fit(
            model.body.structure, scale.from_unit(u), x, simulated=simulated, seed=about.seed
        )
    except CalibError:  # too few rows, or too close to each other
        return None
    selected = select(motor, u, of_body(found, scale, u, x))
    if len(seen[0]) < _FEW_ROWS:  # too few for links of their own
        drawn = np.random.default_rng(about.seed).random((IMAGINED, u.shape[1]))
        seen = drawn, selected.predictor.value(drawn)
    kept = np.arange(0, len(u) * every, every)[selected.rows]
    return _Refit(selected.predictor, found.body, kept, selected.errors, *seen)
