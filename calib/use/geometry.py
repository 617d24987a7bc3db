"""Geometry: joint offsets, link placements and the sensor's frame that fit a model best.

`calib correct` takes the sensor's frame from here, `calib urdf` the offsets and placements.
"""

from __future__ import annotations

import math

import numpy as np

from ..arm.arm import PlanarArm
from ..common.arrays import Array
from ..common.choices import CAUSES, LOG_FRAMES
from ..errors import OptionError
from ..model.alignment import Alignment
from ..model.model import Model
from ..model.nominal import nominal_arm, nominal_in_plane, visited_joints
from .chain_geometry import Geometry, fit_in_plane, fit_in_space

_POINTS, _ROWS = 500, 2_000


def frame_is_free(model: Model, view: str = "auto") -> bool:
    """Whether nothing says how the sensor's frame lies to the robot's root link.

    Positions of a simulation are in the root link's plane; those of a log are in the sensor's
    own frame, unless `view` is "base".
    """
    if view not in LOG_FRAMES:
        raise OptionError(
            f"view {view!r}: expected one of {', '.join(LOG_FRAMES)}", parameter="view", value=view
        )
    based = "base" in (view, model.about.options.get("view"))
    return not is_simulated(model) and not based


def is_simulated(model: Model) -> bool:
    """Whether a model was first learned in simulation."""
    source = model.about.source
    if model.history:
        source = model.history[0].get("from", {}).get("source", source)
    return bool(source != "log")


def fit_geometry(
    model: Model,
    *,
    view: str = "auto",
    cause: str = "sensor",
    move_base: bool = False,
    move_tip: bool = False,
) -> Geometry:
    """Fit the nominal chain to what was learned, where rows were, by Gauss-Newton.

    Unknown are the joints' offsets and places and the tip's (of an arm in space six numbers for
    each joint origin), and with a free frame the sensor's place and, for other units than m, its
    scale.  The prior settles what the data cannot tell apart, such as an offset and a turned link;
    the intervals hold that freedom.

    model : it must have a URDF
    view : {"auto", "base"}, "base" says that a log's positions are in the root link's frame
    cause : {"sensor", "joints"}, what an adaptation found that turns the sensor's frame and the
        first joint alike; with "joints" the frame is taken to have stayed
    move_base : whether the first joint's place is fitted too; only in a known frame
    move_tip : whether the sensed point of a spatial arm is the tip itself and belongs to the
        geometry; else it is a probe or tag that was put on, and the tip stays where the URDF has it
    """
    arm, free = nominal_arm(model), frame_is_free(model, view)
    if move_base and free:
        raise OptionError(
            "the base cannot be told from the sensor's frame",
            hint="say that the log is in the robot's root frame with `view='base'`",
            parameter="view",
        )
    if not free and model.about.unit != "m":
        raise OptionError(
            f"the model's positions are in {model.about.unit!r}, a URDF's are in m",
            hint="adapt it with a log in m (or `unit='mm'`)",
            parameter="unit",
            value=model.about.unit,
        )
    q, x, error = _points(model)
    # undo what adaptations found to be the sensor's
    for moved in reversed(frames(model, cause)):
        x = moved.inverse().apply(x)
    if isinstance(arm, PlanarArm):
        if free and cause == "joints" and model.history and model.body is not None:
            # the sensor stayed where it was before the adaptations; fitted again, its frame would
            # take what they found of the first joint
            structure, beta = nominal_in_plane(model)
            seen = structure.predict(q, beta)
            for moved in reversed(frames(model)):
                seen = moved.inverse().apply(seen)
            x = Alignment.between(arm.forward(q), seen).inverse().apply(x)
            free = False
        if move_tip:
            raise OptionError("a planar arm's tip is always written", parameter="move_tip")
        return fit_in_plane(
            arm, q, x, model.about.unit, free=free, move_base=move_base, error=error
        )
    return fit_in_space(
        arm, model.body, q, x, unit=model.about.unit, free=free, probe=not is_simulated(model),
        move_base=move_base, move_tip=move_tip,
    )  # fmt: skip


def frames(model: Model, cause: str = "sensor") -> list[Alignment]:
    """Return how the sensor's frame moved, adaptation after adaptation.

    None with the cause "joints", which says that it stayed.
    """
    if cause not in CAUSES:
        raise OptionError(
            f"cause {cause!r}: expected one of {', '.join(CAUSES)}", parameter="cause", value=cause
        )
    if cause == "joints":
        return []
    return [Alignment.from_json(e["frame"]) for e in model.history if e.get("frame") is not None]


def _points(model: Model) -> tuple[Array, Array, float]:
    """Joint values and positions [unit] where rows were, and the least error of their mean.

    They are the rows themselves where kept, else the motor nodes that rows visited, at which
    the model answers: its error there is that of its own rows, and larger than the residual.
    """
    if model.rows is not None and not model.history:
        some = slice(None, None, -(-len(model.rows) // _ROWS))
        return model.rows.q[some], model.rows.x[some], 0.0
    q = visited_joints(model, _POINTS)
    x = model.forward(q)
    known = np.isfinite(x).all(axis=1)
    noise = float(np.nanmedian(model.bounds)) / 2.45  # standard deviation along an axis
    error = noise * math.sqrt(len(q) / max(model.about.samples, 10))
    return q[known], x[known], error
