"""LeRobot: a motors' calibration file with the arm's corrected zeros."""

import json
import math
from collections.abc import Mapping

from ..common.atomic import FilePath
from ..common.wording import listing
from ..errors import OptionError
from ..model.model import Model
from ..recording.lerobot import TICKS, Motors
from .geometry import Quantity
from .geometry_fit import fit_geometry, seen_in_lengths

# the register `Homing_Offset` holds a sign and eleven bits
_LARGEST_OFFSET = 2047
_MOST_DOUBT = math.radians(10.0)  # a zero with a wider interval is not reported

RANGES_MOVE = "the ends of the motors' ranges move with their zeros: drive to them with care"
"""A note for whoever writes corrected zeros."""


def zeros_of(model: Model) -> dict[str, Quantity]:
    """Return the zeros of the joints that the log determines, with the drawing's geometry trusted.

    The first joint's is one with the sensor's frame, the last one's often with a turn of what is
    in the hand: those are left out.
    """
    seen = seen_in_lengths(model)
    offsets = fit_geometry(seen, geometry_is_drawn=True).offsets()
    return {
        name: zero
        for name, zero in offsets.items()
        if 0.0 < zero.interval < _MOST_DOUBT
    }


def with_corrected_zeros(
    path: FilePath, zeros: Mapping[str, Quantity]
) -> tuple[str, dict[str, int]]:
    """Return LeRobot's calibration with corrected zeros, and by how many ticks each moved.

    A Feetech motor reports `Present_Position = Actual_Position - Homing_Offset`, whatever its
    `drive_mode` (huggingface/lerobot, src/lerobot/motors/feetech): a joint that is `offset`
    further than it reports needs a homing offset smaller by as much.  The range stays, since its
    middle is the zero.

    path : of `calibration.json`
    zeros : by joint what has to be added to its value [rad]
    Raises LogError if the file is none, OptionError if the motors are not those of the arm, or a
    zero is out of reach.
    """
    calibration = Motors.read(path)
    missing = [name for name in zeros if name not in calibration.document]
    if missing:
        raise OptionError(
            f"the calibration has the motors {listing(calibration.document)}, not "
            f"{listing(missing)} of the model"
        )
    ticks = {
        name: -round(float(zero.value) * TICKS / math.tau)
        for name, zero in zeros.items()
    }
    document = {
        name: dict(entry) for name, entry in calibration.document.items()
    }
    for name, change in ticks.items():
        homing_offset = int(document[name]["homing_offset"]) + change
        if abs(homing_offset) > _LARGEST_OFFSET:
            raise OptionError(
                f"{name}: its homing offset would be {homing_offset} ticks, at most "
                f"{_LARGEST_OFFSET} are possible: put its horn on a tooth further"
            )
        document[name]["homing_offset"] = homing_offset
    return json.dumps(document, indent=4) + "\n", ticks
