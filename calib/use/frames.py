"""Frames: how a sensor's lies to the robot's, and what is assumed where that is unknown."""

from ..common.scale import METRES
from ..model.alignment import Alignment
from ..model.model import Model

_FRAME_IS_FITTED = (
    "the sensor's frame is fitted to the log, so the first joint's offset is "
    "taken as zero"
)
_SAY_BASE = (
    "; if the log is in the robot's root frame, train with `view='base'`"
)
_TOUCHED = "no touch tells the first joint's offset nor where the base stands: both are as drawn"


def frame_is_free(model: Model) -> bool:
    """Whether it is unknown how the sensor's frame lies to the robot's root link.

    Positions of a simulation are in the root link's plane; those of a log are in the sensor's
    own frame, unless the model was trained with the view "base".
    """
    based = model.about.options.get("view") == "base"
    return not is_simulated(model) and not based


def assumption(model: Model) -> str:
    """The assumption of a model about an unknown frame of its sensor."""
    # in the base's frame without the option: the arm touched points, there is no sensor
    touched = model.body is not None and model.body.structure.view == "base"
    if touched:
        return _TOUCHED
    if model.about.unit not in METRES:  # a camera's pixels
        return _FRAME_IS_FITTED
    return _FRAME_IS_FITTED + _SAY_BASE


def is_simulated(model: Model) -> bool:
    """Whether a model was first learned in simulation."""
    source = model.about.source
    if model.history:
        source = model.history[0].get("from", {}).get("source", source)
    return bool(source != "log")


def frame_moves(model: Model) -> list[Alignment]:
    """Return how adaptations found the sensor's frame moved, one after the other."""
    entries = [state.get("frame") for state in model.history]
    return [
        Alignment.from_json(entry) for entry in entries if entry is not None
    ]
