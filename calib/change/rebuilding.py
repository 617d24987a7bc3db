"""Rebuilding: the model of an updated belief, its maps carried along, its bounds made anew.

No map is trained again.  Each sensory node moves as far as the motor nodes it is linked with say;
what local models add to the body moves with the tip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array
from ..common.scale import Scale
from ..common.wording import for_people
from ..maps import local_models
from ..maps.association import Association
from ..maps.linear_models import LinearModels, from_shifts, to_shifts
from ..maps.local_models import NO_MODELS, exponents
from ..maps.map import Map
from ..maps.predictor import BodyInBox, Predictor
from ..model.alignment import Alignment
from ..model.model import Model
from .adaptation import Adaptation
from .comparison import Comparison
from .frame import carried_offset

_TAIL = 3.0  # 95 % quantile over median; of Gaussian noise in the plane it is 2.1
_MOST = 0.5  # of the rows beyond a 95 % bound: it does not hold for their arm

_Value = Callable[[Array], Array]
"""Positions (n, m) at points (n, dof) of the unit box."""

_PER_NODE = 5
_DEGREE, _SAMPLES = 2, 20  # of local models where there were none
_NOTHING = 1e-9  # of the extent: less is nothing to keep


def rebuilt(found: Comparison, body: Body) -> Model:
    """The model with the updated body, maps that follow it, and new bounds."""
    model, scale = found.model, found.model.motor.scale

    def value(u: Array) -> Array:
        q = scale.from_unit(u)
        added = model.predictor.value(u) - found.body.predict(q)
        if np.any(added):
            added = carried_offset(found.body, body, body.beta, q, added)
        return body.predict(q) + added

    fresh = carried(model, body, value)
    nodes = scale.from_unit(np.clip(fresh.motor.units, 0.0, 1.0))
    bounds = [body.bound(nodes, noise=noise) for noise in (True, False)]
    winners = fresh.motor.nearest(scale.to_unit(found.q))[1][:, 0]
    visited = model.visited | (np.bincount(winners, minlength=fresh.motor.size) > 0)
    return replace(fresh, bounds=bounds[0], model_bounds=bounds[1], visited=visited)


def doubts(found: Comparison, fresh: Model, *, real: bool) -> tuple[Model, str] | None:
    """The old model with wider bounds and why, where the rows contradict its own; else None.

    Rows do where most of them lie beyond the bound, or where they have drifted: waves along a line
    missed a fifth of the rows, and the bound covered 31 % of the box.

    fresh : what the rows made of the model, although it is no better at them
    real : whether the rows were measured, not simulated
    """
    model = found.model
    missed = found.missed[found.kept]
    bound = model.expected_error(found.q[found.kept])
    # Noise alone is no error of the model: then rows miss evenly, and nothing explains them better.
    tail = float(np.quantile(missed, 0.95))
    noise = not found.changed and tail < _TAIL * float(np.median(missed))
    # The bound of an exact simulation says nothing of a real arm.
    noise &= not (real and found.body.simulated)
    beyond = not noise and np.mean(missed > bound) > _MOST
    if not beyond and found.score <= 1.0:
        return None
    u = np.clip(model.motor.units, 0.0, 1.0)
    apart = np.linalg.norm(fresh.predictor.value(u) - model.predictor.value(u), axis=1)
    apart = np.maximum(apart + fresh.model_bounds, tail)
    wider = replace(
        model,
        bounds=np.maximum(model.bounds, apart),
        model_bounds=np.maximum(model.model_bounds, apart),
    )
    factor, name = for_people(found.unit)
    size = [f"{factor * float(v.mean()):.3g}" for v in (missed, bound, apart)]
    if not beyond:
        return wider, (
            "the rows show more than noise, but not what changed: the prediction stays, "
            f"but it is known to {size[2]} {name} only (mean of the 95 % bound)"
        )
    return wider, (
        f"the rows are missed by {size[0]} {name} on average, the model's bound there is {size[1]} "
        f"{name}: the bound does not hold for this arm, one of {size[2]} {name} would"
    )


def elsewhere(found: Comparison, made: Adaptation, fresh: Model) -> str:
    """What an improvement at rows of a line or a corner says of the rest, in one line."""
    factor, name = for_people(found.unit)
    before, after = (factor * e["mean"] for e in (made.before, made.after))
    bound = factor * float(np.median(fresh.model_bounds))
    return (
        f"improved at the rows ({before:.3g} to {after:.3g} {name}), which measured "
        f"{100 * made.coverage:.0f} % of the learned range: unknown elsewhere, where the position "
        f"is known to {bound:.3g} {name} (median of the 95 % bound)"
    )


def carried(model: Model, body: Body | None, value: _Value) -> Model:
    """The model with another prediction.

    model : the old model
    body : what stands under the maps from now on
    value : the new prediction, with what maps add to the body
    Returns Model, with old bounds and facts; its maps, Hebbian links and local models follow the
    prediction.
    """
    motor, old = model.motor, model.association
    nodes = np.clip(motor.units, 0.0, 1.0)
    linear = body is None and isinstance(model.predictor.smooth, LinearModels)
    if linear:
        predictor = Predictor(motor, LinearModels.following(motor, value), NO_MODELS)
    else:
        drawn = np.random.default_rng(0).random((_PER_NODE * motor.size, nodes.shape[1]))
        u = np.concatenate([nodes, drawn])
        assert body is not None  # noqa: S101 - without a body the maps stand alone
        predictor = _refitted(model, body, u, value(u))
    sensory = _moved(model, model.predictor.value(nodes), predictor.value(nodes))
    means = old.sensory_means
    if means is not None:  # as many spacings from the nodes as before
        means = from_shifts(sensory, to_shifts(old.sensory, means).astype(float))
    association = Association(motor, sensory, model.links, old.wiring, old.motor_means, means)
    if linear:  # the moved nodes and the links say it from now on
        predictor = Predictor(motor, association.linear, NO_MODELS)
    return replace(
        model, association=association, predictor=predictor, body=body, rows=None, seconds={}
    )


def _refitted(model: Model, body: Body, u: Array, wanted: Array) -> Predictor:
    """The body, and local models of what it leaves over of a prediction."""
    old, motor = model.predictor, model.motor
    smooth = BodyInBox(body, motor.scale)
    residual = wanted - smooth.value(u)
    extent = float(np.linalg.norm(np.ptp(wanted, axis=0)))
    if float(np.abs(residual).max()) < _NOTHING * extent:
        return Predictor(motor, smooth, NO_MODELS)
    degree = max(old.models.degree, _DEGREE)
    samples = max(_SAMPLES, 2 * len(exponents(u.shape[1], degree)))
    models = local_models.fit(motor, np.arange(motor.size), u, residual, (degree, samples))
    return Predictor(motor, smooth, models)


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
