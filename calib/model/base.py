"""Base: the body of a model in the arm's base frame, its sensor left out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.loading import arm_from_urdf
from ..body.belief import Body, Second
from ..body.sensor import sensor_of, without_gauge, without_sensor
from ..body.spatial import structure_of
from .parts import Parts


def in_base(body: Body, *, size: bool = True) -> Body | None:
    """The body with its sensor left out: outputs are the tip in the base frame [m].

    Where the sensor's frame was fitted, the base frame is turned about and shifted along the first
    joint's axis to where the belief has it, by convention, and the spread is what is left; without
    `size` an error of all lengths by one factor is left out too, see `calib.body.sensor`.
    """
    structure: Any = body.structure
    if structure.kind != "spatial" or not structure.informed:
        return None

    def alone(belief: Body | Second) -> dict[str, Any]:
        free = structure.view != "base"
        root = without_gauge(structure, belief, size) if free else belief.root
        kept = ~np.isin(belief.active, sensor_of(structure))
        return {
            "beta": without_sensor(structure, belief.beta)[1],
            "active": belief.active[kept],
            "root": root[kept],
            "noise": np.zeros(3),
        }

    base, none, second = without_sensor(structure, body.beta)[0], np.zeros(3), body.second
    if second is not None:
        second = replace(second, **alone(second))
    return replace(body, structure=base, **alone(body), tau=none, residual=none, second=second)


def drawn(model: Parts) -> Body | None:
    """The drawn arm of a simulation whose arm and sensor were not changed."""
    about = model.about
    if not about.urdf or (about.simulation or {}).get("changes"):
        return None
    arm = arm_from_urdf(about.urdf, about.joint_names, about.tip, lock=about.locked)
    if not isinstance(arm, SpatialArm):
        return None
    structure, none = structure_of(arm, "base"), np.zeros(3)
    active, root = structure.groups["tool"], np.zeros((3, 3))
    return Body(structure, structure.neutral(), active, root, none, 1.0, none, none,
                np.inf, 1.0, simulated=True)  # fmt: skip
