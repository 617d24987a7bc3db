"""Base: the body of a model in the arm's base frame, its sensor left out.

A sensor that stands anywhere cannot tell where the base is turned to about the first joint's axis,
nor, where that joint turns, how far along it; a camera cannot tell how large the arm is. These
directions are a gauge: what is left of them is the prior's, so that they are kept apart.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body, Second
from ..common.arrays import Array

if TYPE_CHECKING:
    from .model import Model

#: A gauge is one where parameters move the tip as it does, but for this share.
_ALIKE = 0.05
_POSES = 60


def in_base(body: Body, *, size: bool = True) -> Body | None:
    """The body with its sensor left out: outputs are the tip in the base frame [m].

    Where the sensor's frame was fitted, the base frame is turned about and shifted along the first
    joint's axis to where the belief has it, by convention, and the spread is what is left; without
    `size` an error of all lengths by one factor is left out too.
    """
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
    found = replace(
        body, structure=base, **own, noise=none, tau=none, residual=none, second=second, packed=None
    )
    if structure.view == "base":
        return found
    second = (
        None if found.second is None else replace(found.second, **_less(found.second, base, size))
    )
    return replace(found, **_less(found, base, size), second=second)


def _less(belief: Body | Second, base: Any, size: bool) -> dict[str, Any]:
    """The covariance without motions of the tip that no reading tells.

    Of all parameters that readings cannot tell apart, those nearest to the belief's stand for them:
    a change of datum (Baarda 1981, S-transformation).
    """
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (_POSES, base.dof))
    position, x = base.linearise(q, belief.beta, belief.active)
    axis, arm = base.chain.axes[0], position - base.chain.points[0]
    motions = [np.cross(axis, arm), np.broadcast_to(axis, arm.shape), *([] if size else [arm])]
    wanted = np.stack([motion.ravel() for motion in motions], axis=1)
    columns = x.reshape(len(wanted), -1) @ belief.root  # of independent standard normal numbers
    ways = np.linalg.lstsq(columns, wanted, rcond=1e-9)[0]
    left = np.linalg.norm(columns @ ways - wanted, axis=0) / np.linalg.norm(wanted, axis=0)
    ways, _ = np.linalg.qr(ways[:, left < _ALIKE])
    root = belief.root - (belief.root @ ways) @ ways.T
    return {"covariance": root @ root.T, "packed": None}


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
