"""The one bound on a model's positions, for any arm; the C source reads the same numbers.

It is the sum of three: what is believed of the arm, how far joint values are beside the rows of a
log without a body, and what play leaves open where the side is not known from which joints came.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from ..common.arrays import Array, Mask
from ..maps.node_bounds import blend_nodes

if TYPE_CHECKING:
    from .parts import Parts

# joints up to which bounds are blended between the motor map's nodes
MOST_BLENDED = 3
STEEP = 2.0  # extents of the workspace that a position may change by over the range of a joint

BoundName = Literal["bounds", "model_bounds"]
"""On what `about.bound_of` says, or on the true position in the sensor's frame."""


def position_bound(
    model: Parts, u: Array, which: BoundName, side_known: Mask | None
) -> Array:
    """95 % bound (n,) [unit] at points `u` (n, dof) of the unit box.

    side_known : (n,), whether `u` is where the joints stand; where None it is where they read,
        and they may stand anywhere within their play
    """
    noise = which == "bounds" and model.about.bound_of == "sensor reading"
    scale = model.motor.scale
    believed = model.posterior or model.body
    if believed is not None and u.shape[1] > MOST_BLENDED:
        # a lattice covers too little of their box to blend between its nodes
        bound = believed.bound(scale.from_unit(u), noise=noise)
    else:
        bound = blended_bound(model, u, getattr(model, which), noise=noise)
    if model.approach is None:
        return bound
    # with all joints at the worst side of their play
    slope = model.predictor.value_and_slope(u)[1] / scale.span
    reach = np.linalg.norm(slope * model.approach.play, axis=1).sum(axis=1)
    if side_known is not None:
        reach = np.where(side_known, 0.0, reach)
    return np.asarray(bound + reach)


def blended_bound(
    model: Parts, u: Array, nodes: Array, *, noise: bool
) -> Array:
    """Bounds (n,) at points `u` (n, dof), from those of the nodes (nodes,)."""
    bound = blend_nodes(model.motor, nodes, u)
    scale = model.motor.scale
    wide = bound > model.most_bound
    if model.body is not None and wide.any():
        # beside a joint that hardly moved the posterior widens within less than a node's
        # spacing: a blended bound would refuse the measured rows themselves
        believed = model.body.bound(scale.from_unit(u[wide]), noise=noise)
        bound[wide] = np.minimum(bound[wide], believed)
    if model.seen is not None:
        beside = model.seen.beside(scale, u)
        bound = bound + STEEP * model.solver.extent * beside
    return bound
