"""A model without a body, as a body: its maps' prediction seen through a view that may move.

`check` and `adapt` then compare the same members as for a kinematic model, as far as they are
the sensor's; everything else is a smooth correction of the readout.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body import planar_view
from ..body.belief import Body
from ..body.covariance import RADIUS_95
from ..body.planar import PlanarStructure
from ..body.structure import Indices, Structure
from ..common.arrays import Array
from ..maps.map import search_tree
from ..model.model import Model

_VIEW = ("view.", "lens")
_ALIKE = 3.0  # spacings of nodes within which the errors of maps have one sign


@dataclass(frozen=True)
class SeenStructure(PlanarStructure):
    """A planar structure whose chain is the prediction of a model without a body."""

    model: Any = field(default=None, compare=False)  # what predicts positions

    @property
    def groups(self) -> Mapping[str, Indices]:
        """The view's groups; there are no others."""
        found = {k: ix for k, ix in self.layout.groups.items() if k.startswith(_VIEW)}
        return MappingProxyType(found)

    def chain(self, q: Array, beta: Array) -> NDArray[np.complex128]:  # noqa: ARG002
        """Predicted positions (n,), as complex numbers."""
        value = self.model.predictor.value(self.model.motor.scale.to_unit(q))
        return np.asarray(value[:, 0] + 1j * value[:, 1])

    def linearise(
        self, q: Array, beta: Array, active: Indices | None = None
    ) -> tuple[Array, Array]:
        """Positions (n, 2) and derivatives (n, 2, k) by the view's parameters."""
        active = np.arange(self.size) if active is None else active
        place = np.full(self.size, -1)
        place[active] = np.arange(len(active))
        z, _, out = planar_view.columns(self, self.chain(q, beta), beta, place, len(active))
        return z, out

    def predict_and_slope(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Positions (n, 2) and their derivative (n, 2, dof) by the joint values."""
        scale = self.model.motor.scale
        _, tilt = self.model.predictor.value_and_slope(scale.to_unit(q))
        place = np.full(self.size, -1)
        z, view, _ = planar_view.columns(self, self.chain(q, beta), beta, place, 0)
        return z, np.asarray(view @ (tilt / scale.span))


def seen_body(model: Model) -> Body:
    """The belief over the view of a model that has no body: it is as it was."""
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
