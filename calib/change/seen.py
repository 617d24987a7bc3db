"""A model without a body, as a body: its maps' prediction seen through a view that may move.

`check` and `adapt` then compare the same members as for a kinematic model, as far as they are
the sensor's; everything else is a smooth correction of the readout.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.covariance import RADIUS_95
from ..body.derivative import Derivative
from ..body.measurement import Moved, Sight, TipMotion
from ..body.parameters import Block, Indices
from ..body.planar import PlanarStructure
from ..body.structure import Structure
from ..common.arrays import Array
from ..maps.map import search_tree
from ..model.model import Model

_ALIKE = 3.0  # spacings of nodes within which the errors of maps have one sign


@dataclass(frozen=True)
class SeenStructure(PlanarStructure):
    """A planar structure whose chain is the prediction of a model without a body."""

    model: Any = field(default=None, compare=False)  # what predicts positions

    def geometry(self) -> tuple[Block, ...]:
        """Blocks of the chain: there are none."""
        return ()

    def seen(self, q: Array, beta: Array) -> tuple[TipMotion, Sight]:
        """Where the model predicts the tip, and what the view makes of it."""
        value = self.model.predictor.value(self.model.motor.scale.to_unit(q))
        motion = _Predicted(np.ascontiguousarray(value.T))
        return motion, self.measurement.look(self.seeing(beta), motion, q[:, :0])

    def derivative(self, q: Array, beta: Array, active: Indices) -> tuple[Array, Derivative]:
        """Positions (n, 2) and derivatives (n, 2, k) by the view's parameters."""
        sight, out = self.seen(q, beta)[1], np.zeros((len(q), 2, self.size))
        for name, columns in sight.columns():
            moved = columns().reshape(-1, 2, len(q))
            out[:, :, self.groups[name]] = moved.transpose(2, 1, 0)
        return sight.values, Derivative.of(out[:, :, active])

    def predict_and_slope(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Positions (n, 2) and their derivative (n, 2, dof) by the joint values."""
        scale = self.model.motor.scale
        tilt = self.model.predictor.value_and_slope(scale.to_unit(q))[1] / scale.span
        sight = self.seen(q, beta)[1]
        return sight.values, sight.push(tilt.transpose(2, 1, 0)).transpose(2, 1, 0)


class _Predicted(NamedTuple):
    """Tips that a model predicts, (2, n)."""

    position: Array

    def joints(self) -> Moved:
        """Nothing moves them."""
        return np.zeros((0, *self.position.shape)), 0.0


def body_of(model: Model) -> Body:
    """The belief of a model; of one without a body that over its view, which is as it was."""
    if model.body is not None:
        return model.body
    about = model.about
    q = model.motor.weights[model.visited]
    x = model.predictor.value(model.motor.scale.to_unit(q))
    centre = x.mean(axis=0)
    extent = float(np.sqrt(((x - centre) ** 2).sum(axis=1).mean()))
    structure = SeenStructure(
        about.joint_names, about.revolute, "rigid", about.unit, metre=1.0, lens=False,
        signs=(1,) * len(about.joint_names), mirror=1, extent=extent,
        centre=(float(centre[0]), float(centre[1])), nominal=None, simulated=False, model=model,
    )  # fmt: skip
    noise = model.baseline.noise if model.baseline is not None else 1e-4 * extent
    bound = float(np.median(model.bounds[model.visited])) / RADIUS_95
    own = np.sqrt(max(bound**2 - noise**2, (0.3 * bound) ** 2))
    return Body(
        structure, np.zeros(structure.size), np.zeros(0, dtype=np.intp), np.zeros((0, 0)),
        noise=np.full(2, max(noise, 1e-6 * extent)), kappa=1.0, tau=np.full(2, own),
        residual=np.zeros(2), nu=6.0, autocorrelation=1.0,
    )  # fmt: skip


def design_effect(structure: Structure, q: Array, noise: float) -> float:
    """How much more a sum over rows varies by the errors of maps than by noise alone (Kish 1965).

    A lattice's errors keep their sign over some nodes: they are neither the noise of single rows
    nor a residual as smooth as a body's.  1 where a body predicts.

    q : (n, dof)
    noise : [unit], of one row along an axis, with the errors of maps in it
    """
    if not isinstance(structure, SeenStructure):
        return 1.0
    model = structure.model
    own = np.nanmean((model.model_error(q) / RADIUS_95) ** 2)
    tree = search_tree(model.motor.scale.to_unit(q), model.motor.scale)
    others = int(tree.count_neighbors(tree, _ALIKE * model.motor.spacing)) / len(q) - 1.0
    return float(1.0 + others * min(own / noise**2, 1.0))
