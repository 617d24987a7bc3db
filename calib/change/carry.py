"""Carrying: maps, Hebbian links and local models that follow an updated body.

Nothing is trained again.  Each sensory node moves as far as the motor nodes it is linked with
say; what local models add to the body moves with the tip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..body.basis import exponents
from ..body.belief import Body
from ..body.trend import Trend
from ..common.arrays import Array
from ..common.robust import solve
from ..common.scale import Scale
from ..maps import local_models
from ..maps.association import Association
from ..maps.linear_models import LinearModels, from_shifts, to_shifts
from ..maps.local_models import NO_MODELS, LocalModels
from ..maps.map import Map
from ..maps.predictor import BodyInBox, Both, Predictor, Smooth

if TYPE_CHECKING:
    from ..model.model import Model

Value = Callable[[Array], Array]
"""Positions (n, m) at points (n, dof) of the unit box."""

_PER_NODE = 5
_DEGREE, _SAMPLES = 2, 20  # of local models where there were none
_NOTHING = 1e-9  # of the extent: less is nothing to keep


def carry(model: Model, body: Body | None, value: Value) -> Model:
    """The model with another prediction.

    model : the old model
    body : what stands under the maps from now on
    value : the new prediction, with what maps add to the body
    Returns Model, with old bounds and facts; its maps, Hebbian links and local models follow the
    prediction.
    """
    motor = model.motor
    rng = np.random.default_rng(0)
    drawn = rng.random((_PER_NODE * motor.size, motor.units.shape[1]))
    u = np.concatenate([np.clip(motor.units, 0.0, 1.0), drawn])
    wanted = value(u)
    linear = body is None and isinstance(model.predictor.smooth, LinearModels)
    if linear:
        predictor = Predictor(motor, LinearModels.following(motor, value), NO_MODELS)
    else:
        smooth = _smooth(model, body, u, wanted)
        predictor = Predictor(motor, smooth, _models(model, smooth, u, wanted))
    sensory = _moved(model, predictor)
    old = model.association
    association = Association(
        motor, sensory, model.links, old.wiring, old.motor_means, _means(old, sensory)
    )
    if linear:  # the moved nodes and the links say it from now on
        predictor = Predictor(motor, association.linear, NO_MODELS)
    return replace(
        model, association=association, predictor=predictor, body=body, rows=None, seconds={}
    )


def _means(old: Association, sensory: Map) -> Array | None:
    """Mean activity positions of the moved nodes: as many spacings from them as before."""
    if old.sensory_means is None:
        return None
    return from_shifts(sensory, to_shifts(old.sensory, old.sensory_means).astype(float))


def _smooth(model: Model, body: Body | None, u: Array, wanted: Array) -> Smooth:
    """The smooth part: the body, and a trend of the old kind for what it leaves over."""
    old = model.predictor.smooth
    trend = old.second if isinstance(old, Both) else old
    if body is None:
        assert isinstance(trend, Trend)  # noqa: S101 - without a body there is a trend alone
        return Trend(trend.basis, solve(trend.basis.values(u), wanted))
    inside = BodyInBox(body, model.motor.scale)
    if not isinstance(old, Both) or not isinstance(trend, Trend):
        return inside
    return Both(inside, Trend(trend.basis, solve(trend.basis.values(u), wanted - inside.value(u))))


def _models(model: Model, smooth: Smooth, u: Array, wanted: Array) -> LocalModels:
    """Local models of what the smooth part leaves over of the new prediction."""
    residual = wanted - smooth.value(u)
    extent = float(np.linalg.norm(np.ptp(wanted, axis=0)))
    if float(np.abs(residual).max()) < _NOTHING * extent:
        return NO_MODELS
    old = model.predictor.models
    degree, motor = max(old.degree, _DEGREE), model.motor
    samples = max(_SAMPLES, 2 * len(exponents(motor.units.shape[1], degree)))
    return local_models.fit(
        motor.units, u, residual, motor.scale, degree, samples, spacings=motor.spacings
    )


def _moved(model: Model, predictor: Predictor) -> Map:
    """The sensory map, each node moved by the mean of the motor nodes that it is linked with."""
    old, motor = model.sensory, model.motor
    u = np.clip(motor.units, 0.0, 1.0)
    before, after = model.predictor.value(u), predictor.value(u)
    links = model.links
    total = np.asarray(links.sum(axis=0)).ravel()
    safe = np.maximum(total, 1e-300)
    here = np.asarray(links.T @ before) / safe[:, None]
    there = np.asarray(links.T @ after) / safe[:, None]
    # an affine map of the means, so that what a node differs from its partners is mapped too
    known = total > 0
    design = np.concatenate([before, np.ones((len(before), 1))], axis=1)
    affine = np.linalg.lstsq(design, after, rcond=None)[0]
    weights = old.weights
    moved = np.concatenate([weights, np.ones((len(weights), 1))], axis=1) @ affine
    mean = np.concatenate([here, np.ones((len(here), 1))], axis=1) @ affine
    moved[known] += (there - mean)[known]
    scale = Scale.of_data(np.concatenate([moved, after]))
    return Map(scale.to_unit(moved), old.lattice, scale, old.history)


def carried_offset(old: Body, new: Body, beta: Array, q: Array, offset: Array) -> Array:
    """What maps add to a body, after the arm or the sensor has changed.

    A displacement of the tip is taken as that of the joints that causes it (least squares), and
    these joints' displacement in the new prediction: a moved sensor turns it exactly.

    beta : (d,), parameters of the new prediction
    q, offset : (n, dof), (n, m)
    Returns (n, m).
    """
    before = old.structure.slope(q, old.beta)
    after = new.structure.slope(q, beta)
    joints = np.einsum("ndm,nm->nd", np.linalg.pinv(before, rcond=1e-3), offset)
    return np.asarray(np.einsum("nmd,nd->nm", after, joints))
