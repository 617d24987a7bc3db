"""Base: the body of a model in the arm's base frame, its sensor left out."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body

if TYPE_CHECKING:
    from .model import Model

Array = NDArray[np.float64]


def in_base(body: Body) -> Body | None:
    """The body with its sensor left out: outputs are the tip in the base frame [m]."""
    structure: Any = body.structure
    if structure.kind != "spatial" or not structure.informed:
        return None
    base = structure.with_view("base", unit="m", metre=1.0, extent=structure.chain.reach)
    sensor = ("view.rotation", "view.shift", "view.scale", "lens")
    index = np.concatenate([structure.groups[group] for group in sensor])
    neutral = structure.neutral()

    def without(beta: Array, active: NDArray[np.intp], covariance: Array) -> dict[str, Any]:
        own = beta.copy()
        own[index] = neutral[index]
        kept = ~np.isin(active, index)
        return {"beta": own, "active": active[kept], "covariance": covariance[np.ix_(kept, kept)]}

    none, second = np.zeros(3), body.second
    if second is not None:
        own = without(second.beta, second.active, second.covariance)
        second = replace(second, **own, noise=none, packed=None)
    own = without(body.beta, body.active, body.covariance)
    return replace(
        body, structure=base, **own, noise=none, tau=none, residual=none, second=second, packed=None
    )


def drawn(model: Model) -> Body | None:
    """The drawn arm of a simulation whose arm and sensor were not changed."""
    from ..arm.arms import SpatialArm
    from ..arm.loading import arm_from_urdf
    from ..body.spatial import structure_of

    about = model.about
    if not about.urdf or (about.simulation or {}).get("changes"):
        return None
    arm = arm_from_urdf(about.urdf, about.joint_names, about.tip, lock=about.locked)
    if not isinstance(arm, SpatialArm):
        return None
    structure, none = structure_of(arm, "base"), np.zeros(3)
    active, covariance = structure.groups["tool"], np.zeros((3, 3))
    return Body(structure, structure.neutral(), active, covariance, none, 1.0, none, none,
                np.inf, 1.0, simulated=True)  # fmt: skip
