"""Frames: how a sensor's lies to the robot's, and what is assumed where nothing says so."""

from __future__ import annotations

from ..common.choices import LOG_FRAMES
from ..errors import OptionError
from ..model.alignment import Alignment
from ..model.model import Model

FRAME_IS_FITTED = (
    "the sensor's frame is fitted to the log, so the first joint's offset is taken as zero; if the "
    "log is in the robot's root frame, give `view='base'`"
)
"""What is assumed where nothing says how the sensor's frame lies."""


def frame_is_free(model: Model, view: str = "auto") -> bool:
    """Whether nothing says how the sensor's frame lies to the robot's root link.

    Positions of a simulation are in the root link's plane; those of a log are in the sensor's
    own frame, unless `view` is "base".
    """
    if view not in LOG_FRAMES:
        raise OptionError(
            f"view {view!r}: expected one of {', '.join(LOG_FRAMES)}",
            parameter="view",
            value=view,
        )
    based = "base" in (view, model.about.options.get("view"))
    return not is_simulated(model) and not based


def is_simulated(model: Model) -> bool:
    """Whether a model was first learned in simulation."""
    source = model.about.source
    if model.history:
        source = model.history[0].get("from", {}).get("source", source)
    return bool(source != "log")


def frames(model: Model) -> list[Alignment]:
    """Return how adaptations found the sensor's frame moved, one after the other."""
    entries = [state.get("frame") for state in model.history]
    return [
        Alignment.from_json(entry) for entry in entries if entry is not None
    ]
