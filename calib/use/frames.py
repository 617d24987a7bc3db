"""Frames: how a sensor's lies to the robot's, and what is assumed where nothing says so."""

from __future__ import annotations

from ..common.choices import CAUSES, LOG_FRAMES
from ..errors import OptionError
from ..model.alignment import Alignment
from ..model.model import Model
from ..model.nominal import moves_in_space

_FREE = (
    "the sensor's frame is fitted to the log, so the first joint's offset is taken as zero; if the "
    "log is in the robot's root frame, give `view='base'`"
)
_STAYS = (
    "`cause='joints'` applies to what an adaptation found in a plane, else it is said to the "
    "adaptation itself: here the first joint's offset stays zero"
)
_BEFORE = (
    "the sensor's frame is taken as it was before the adaptation, where the first joint's offset "
    "was taken as zero"
)


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


def frames(model: Model, cause: str = "sensor") -> list[Alignment]:
    """Return how the sensor's frame moved, adaptation after adaptation.

    None with the cause "joints", which says that it stayed.
    """
    if cause not in CAUSES:
        raise OptionError(
            f"cause {cause!r}: expected one of {', '.join(CAUSES)}",
            parameter="cause",
            value=cause,
        )
    if cause == "joints":
        return []
    return [
        Alignment.from_json(e["frame"])
        for e in model.history
        if e.get("frame") is not None
    ]


def frame_notes(model: Model, cause: str) -> tuple[str, ...]:
    """Return what is assumed where the sensor's frame is fitted to the model's own log."""
    if cause == "sensor":
        return (_FREE,)
    return (
        (_BEFORE,) if model.history and not moves_in_space(model) else (_FREE, _STAYS)
    )
