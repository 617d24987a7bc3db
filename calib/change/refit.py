"""Refitting: what leads from joints to positions, learned anew from the rows since a change.

With a body the changed arm is a body again, so that a few rows speak for the whole range;
without one the trends and local models of the maps are chosen as in training.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..body.fitting import fit_structure
from ..common.arrays import Array
from ..errors import CalibError
from ..maps.map import Map
from ..maps.model_selection import Candidate, of_body, of_trends, select
from ..maps.predictor import Predictor

if TYPE_CHECKING:
    from ..body.belief import Body
    from ..model.model import Model

_ROWS = 3000  # rows that a body is refitted to: more would tell it hardly more
_NO_ARM = 0.02  # share of the extent: a body that is further off is compared with trends
_NOISE_FLOOR = 1.5  # so is that of a simulation beyond so many times the usual noise
_FEW_ROWS = 1000  # fewer have no links of their own
_IMAGINED = 20_000  # samples from which links are learned


@dataclass(frozen=True, eq=False)
class Refit:
    """What was learned."""

    predictor: Predictor  # smooth part and local models
    body: Body | None  # the body under the local models, if there is one
    rows: NDArray[np.intp]  # (m,), rows that were held out in turn
    errors: Array  # (m,) [unit], their held-out errors
    # (k, dof), (k, n), samples from which links come to rest: joints in the unit box and positions
    u: Array
    v: Array


def refit(model: Model, motor: Map, u: Array, x: Array) -> Refit:
    """Learn from rows what leads from joints to positions.

    model : whose arm it is, as it was before the change
    motor : nodes that carry the local models
    u, x : (n, dof), (n, m), joints in the unit box and positions, ten rows or more
    """
    if model.body is not None:
        found = _with_body(model, motor, u, x)
        if found is not None:
            return found
    selected = select(motor, u, of_trends(motor.scale, model.about.revolute, u, x))
    return Refit(selected.predictor, None, selected.rows, selected.errors, u, x)


def _with_body(model: Model, motor: Map, u: Array, x: Array) -> Refit | None:
    """A body of the rows, None where none can be fitted to them."""
    assert model.body is not None  # noqa: S101
    scale, about = motor.scale, model.about
    every = -(-len(u) // _ROWS)
    seen = u, x
    u, x = u[::every], x[::every]
    simulated = model.body.simulated
    try:
        fit = fit_structure(
            model.body.structure, scale.from_unit(u), x, simulated=simulated, seed=about.seed
        )
    except CalibError:  # too few rows, or too close to each other
        return None
    candidates: list[Candidate] = [of_body(fit, scale, u, x)]
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    usual = _NO_ARM * extent
    if simulated:  # an exact lens or gear is smooth: a trend follows it
        noise = model.baseline.noise if model.baseline is not None else 0.0
        usual = _NOISE_FLOOR * noise + 1e-6 * extent
    if float(np.linalg.norm(fit.held_out, axis=1).mean()) > usual and len(u) > 100:
        candidates += of_trends(scale, about.revolute, u, x, candidates[0])
    selected = select(motor, u, candidates)
    if len(seen[0]) < _FEW_ROWS:  # too few for links of their own
        drawn = np.random.default_rng(about.seed).random((_IMAGINED, u.shape[1]))
        seen = drawn, selected.predictor.value(drawn)
    kept = np.arange(0, len(u) * every, every)[selected.rows]
    return Refit(selected.predictor, fit.body, kept, selected.errors, *seen)
