"""About: the facts that a model keeps of its samples and options, when training makes it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..model.about import About
from ..samples.samples import Samples
from .learn import Options


def about_of(samples: Samples, options: Options, taught: bool) -> About:
    """What is known before anything is learned; errors and notes are added later."""
    arm, simulation = samples.arm, samples.simulation
    plane = samples.plane or getattr(arm, "plane", None)
    stated: Mapping[str, Any] | None = None
    if plane is not None:
        stated = {k: getattr(plane, k).tolist() for k in ("origin", "x", "y")}
    return About(
        robot=arm.name if arm is not None else "",
        tip=arm.tip if arm is not None else "",
        joint_names=samples.joint_names,
        revolute=samples.revolute,
        lower=samples.lower,
        upper=samples.upper,
        locked=dict(arm.locked) if arm is not None else {},
        plane=stated,
        unit=samples.unit,
        bound_of="true position" if simulation is not None else "sensor reading",
        source="simulation" if simulation is not None else "log",
        taught=taught,
        samples=len(samples),
        seed=options.seed,
        options=options.to_json(),
        simulation=simulation.to_json() if simulation is not None else None,
        urdf=arm.urdf if arm is not None else "",
        columns=samples.columns,
        degrees=samples.degrees,
        picture=samples.camera.size if samples.camera is not None else None,
    )
