"""The nominal arm in the sensor's frame: where a controller that trusts the URDF wants the tip.

The sensor's frame, scale and lens are the body's, all else is the URDF's: what a correction
compensates is in the arm and never in the sensor's frame.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from ..arm.arm import PlanarArm, SpatialArm
from ..arm.loading import arm_from_urdf
from ..body.drawing import PlanarDrawing
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure, structure_of
from ..body.structure import Structure
from ..common.arrays import Array
from ..common.rows import spread_rows
from ..common.scale import METRES
from ..errors import CalibError, OptionError
from ..kernel.arm import KernelArm
from .alignment import Alignment
from .parts import ModelParts


def nominal_in_plane(
    model: ModelParts, *, in_root_frame: bool = False
) -> tuple[PlanarStructure, Array]:
    """Structure and parameters (d,) of the nominal arm of a model with a planar body.

    Seen by the sensor that the body knows, or, where `in_root_frame`, in the robot's root frame.
    """
    body = model.body
    if body is None or not isinstance(body.structure, PlanarStructure):
        raise OptionError(
            "the model has no planar body, so its sensor's frame is not known"
        )
    nominal = body.structure.nominal
    if nominal is None:
        nominal = PlanarDrawing.of(nominal_arm(model))
    structure = body.structure.with_fields(nominal=nominal, signs=nominal.signs)
    if in_root_frame:
        structure = structure.with_sensor(view="base", mirror=nominal.mirror)
        return structure, structure.neutral()
    return structure, nominal_parameters(structure, body.beta)


def nominal_structure(model: ModelParts) -> tuple[Structure, Array]:
    """Structure and parameters (d,) of the nominal arm, seen by the sensor of a model's body."""
    body = model.body
    if body is None or isinstance(body.structure, PlanarStructure):
        return nominal_in_plane(model)
    return body.structure, nominal_parameters(body.structure, body.beta)


def nominal_parameters(structure: Structure, beta: Array) -> Array:
    """The drawing's parameters (d,), with the sensor, the lens and the tool of `beta` (d,)."""
    nominal = structure.neutral()
    for group, indices in structure.groups.items():
        if group.startswith(("view.", "tool", "lens")):
            nominal[indices] = beta[indices]
    return nominal


def moves_in_space(model: ModelParts) -> bool:
    """Whether the arm moves in space: seen in x, y and z, or by a camera from anywhere."""
    return len(model.axes) == 3 or (
        model.body is not None
        and isinstance(model.body.structure, SpatialStructure)
    )


def visited_joints(model: ModelParts, most: int) -> Array:
    """Joints (n, dof) of some motor nodes that rows visited, within the ranges."""
    nodes = np.flatnonzero(model.visited)
    nodes = nodes[spread_rows(len(nodes), most)]
    return np.clip(
        model.motor.weights[nodes], model.about.lower, model.about.upper
    )


def nominal_arm(model: ModelParts) -> PlanarArm | SpatialArm:
    """Return the arm as its URDF describes it."""
    about = model.about
    if not about.urdf:
        raise OptionError(
            "the model has no URDF, so there is no nominal arm to compare it with",
            hint="train it with a robot, or with a robot and a log",
            parameter="robot",
        )
    planar = not moves_in_space(model)
    return arm_from_urdf(
        about.urdf,
        about.joint_names,
        about.tip,
        lock=about.locked,
        planar=planar,
    )


class Goal(IntEnum):
    """Number of residuals that `calib_correct` uses of the arm in its sensor's frame."""

    POSITION = 0  # of what the sensor sees
    PLACE = 3
    POSE = 6


def nominal_for_kernel(
    model: ModelParts, arm: KernelArm
) -> tuple[KernelArm, Goal] | None:
    """Return the nominal arm and its residuals for a correction; None where C cannot correct."""
    fitted = arm.structure
    simulated = model.about.source == "simulation" and not model.history
    goal = Goal.POSITION
    if not model.about.urdf or model.body is None:
        return None
    try:
        if isinstance(fitted, PlanarStructure):
            structure, beta = nominal_in_plane(model, in_root_frame=simulated)
            if structure.signs != fitted.signs:
                # of a reversed joint the wiring has to be mended
                return None
            return KernelArm.of(structure, beta), goal
        if fitted.informed:
            if fitted.dof >= 6:
                goal = Goal.POSE
            elif fitted.outputs == 2:
                goal = Goal.PLACE
            beta = nominal_parameters(fitted, model.body.beta)
            return KernelArm.of(fitted, beta), goal
        if not simulated:
            return None
        drawn = nominal_arm(model)
    except CalibError:
        return None
    if drawn.chain.joints != arm.chain.joints:
        return None
    there = structure_of(drawn, "base")
    return KernelArm.of(there, there.neutral()), goal


_FRAME_IS_FITTED = (
    "the sensor's frame is fitted to the log, so the first joint's offset is "
    "taken as zero"
)
_SAY_BASE = (
    "; if the log is in the robot's root frame, train with `view='base'`"
)
_TOUCHED = "no touch tells the first joint's offset nor where the base stands: both are as drawn"


def has_free_frame(model: ModelParts) -> bool:
    """Whether it is unknown how the sensor's frame lies to the robot's root link.

    Positions of a simulation are in the root link's plane; those of a log are in the sensor's
    own frame, unless the model was trained with the view "base".
    """
    based = model.about.options.get("view") == "base"
    return not is_simulated(model) and not based


def assumption(model: ModelParts) -> str:
    """The assumption of a model about an unknown frame of its sensor."""
    # in the base's frame without the option: the arm touched points, there is no sensor
    if model.body is not None and model.body.structure.view == "base":
        return _TOUCHED
    if model.about.unit not in METRES:  # a camera's pixels
        return _FRAME_IS_FITTED
    return _FRAME_IS_FITTED + _SAY_BASE


def is_simulated(model: ModelParts) -> bool:
    """Whether a model was first learned in simulation."""
    source = model.about.source
    if model.history:
        source = model.history[0].get("from", {}).get("source", source)
    return bool(source != "log")


def frame_moves(model: ModelParts) -> list[Alignment]:
    """Return how adaptations found the sensor's frame moved, one after the other."""
    entries = [state.get("frame") for state in model.history]
    return [
        Alignment.from_json(entry) for entry in entries if entry is not None
    ]
