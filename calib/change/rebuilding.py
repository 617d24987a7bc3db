"""Rebuilding: the model of an updated belief, its maps carried along, its bounds made anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..body.likeness import kernel
from ..common.arrays import Array
from ..common.wording import for_people
from ..model.model import Model
from .adaptation import Adaptation
from .carry import carried_offset, carry
from .comparison import Comparison
from .own_residual import OwnResidual

_RADIUS_95 = 2.448  # radius that holds 95 % of a 2-D Gaussian of standard deviation 1
_TAIL = 3.0  # 95 % quantile over median; of Gaussian noise in the plane it is 2.1
_MOST = 0.5  # of the rows beyond a 95 % bound: it does not hold for their arm


def rebuilt(found: Comparison, body: Body, own: OwnResidual | None, *, anew: bool) -> Model:
    """The model with the updated body, maps that follow it, and new bounds.

    A body that was fitted `anew` holds all that is known: nothing of the maps is carried over.
    """
    model, scale = found.model, found.model.motor.scale

    def value(u: Array) -> Array:
        q = scale.from_unit(u)
        added = model.predictor.value(u) - found.body.predict(q)
        if anew:
            return body.predict(q)
        if np.any(added):
            added = carried_offset(found.body, body, body.beta, q, added)
        predicted = body.predict(q) + added
        return predicted if own is None else predicted + own.value(q)

    fresh = carry(model, body if model.body is not None else None, value)
    nodes = scale.from_unit(np.clip(fresh.motor.units, 0.0, 1.0))
    bounds = [body.bound(nodes, noise=noise) for noise in (True, False)]
    if own is not None and model.body is not None:  # away from the rows nobody knows it
        bounds = [np.hypot(bound, _RADIUS_95 * own.deviation(nodes)) for bound in bounds]
    if model.body is None:
        growth = np.zeros(len(nodes)) if own is None else _growth(found, fresh, own, nodes)
        noise = _RADIUS_95 * float(body.noise[0])
        bounds = [np.hypot(model.bounds, growth), np.hypot(model.model_bounds, growth)]
        bounds[0] = np.maximum(bounds[0], noise)
    winners = fresh.motor.nearest(scale.to_unit(found.q))[1][:, 0]
    visited = model.visited | (np.bincount(winners, minlength=fresh.motor.size) > 0)
    return replace(fresh, bounds=bounds[0], model_bounds=bounds[1], visited=visited)


def _growth(found: Comparison, fresh: Model, own: OwnResidual, nodes: Array) -> Array:
    """What a model without a body does not know away from the rows, (nodes,) [unit].

    Where no view explains the log alone, the old prediction may be right there as well.
    """
    u = np.clip(fresh.motor.units, 0.0, 1.0)
    change = np.linalg.norm(fresh.predictor.value(u) - found.model.predictor.value(u), axis=1)
    near = kernel(nodes, own.q, own.lengths).max(axis=1)
    return np.asarray(np.hypot(_RADIUS_95 * own.deviation(nodes), (1.0 - near) * change))


def doubts(found: Comparison, fresh: Model, *, real: bool) -> tuple[Model, str] | None:
    """The old model with wider bounds and why, where the rows contradict its own; else None.

    Rows do where most of them lie beyond the bound, or where they have drifted: waves along a line
    missed a fifth of the rows, and the bound covered 31 % of the box.

    fresh : what the rows made of the model, although it is no better at them
    real : whether the rows were measured, not simulated
    """
    model = found.model
    q, x = found.q[found.kept], found.x[found.kept]
    missed = np.linalg.norm(x - model.predictor.value(model.motor.scale.to_unit(q)), axis=1)
    bound = model.expected_error(q)
    # Noise alone is no error of the model: then rows miss evenly, and nothing explains them better.
    noise = not found.changed and float(np.quantile(missed, 0.95)) < _TAIL * np.median(missed)
    # The bound of an exact simulation says nothing of a real arm.
    noise &= not (real and found.body.simulated)
    beyond = not noise and np.mean(missed > bound) > _MOST
    if not beyond and found.score <= 1.0:
        return None
    u = np.clip(model.motor.units, 0.0, 1.0)
    apart = np.linalg.norm(fresh.predictor.value(u) - model.predictor.value(u), axis=1)
    apart = np.maximum(apart + fresh.model_bounds, np.quantile(missed, 0.95))
    wider = replace(
        model,
        bounds=np.maximum(model.bounds, apart),
        model_bounds=np.maximum(model.model_bounds, apart),
    )
    factor, name = for_people(found.unit)
    size = [f"{factor * float(v.mean()):.3g}" for v in (missed, bound, apart)]
    if not beyond:
        return wider, (
            "the rows show more than noise, but not what changed: the prediction stays, and is now "
            f"said to be known to {size[2]} {name} (mean of the 95 % bound)"
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
