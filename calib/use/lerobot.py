"""LeRobot: a motor calibration whose zeros are those of the calibrated arm.

As huggingface/lerobot has it (src/lerobot/motors): a Feetech motor tells `Present_Position =
Actual_Position - Homing_Offset` (`FeetechMotorsBus._get_half_turn_homings`), 4096 ticks a turn, and
in degrees `(present - (range_min + range_max) / 2) * 360 / 4095`, whatever `drive_mode` says
(`MotorsBus._normalize`).  So a joint that stands `offset` further than it tells needs a homing
offset that is so much smaller; its range stays, because the middle of it is the zero.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..common.wording import listed
from ..errors import LogError, OptionError

TICKS = 4096
_REGISTER = 2047  # Homing_Offset is a sign and eleven bits


def read_calibration(path: str | os.PathLike[str]) -> dict[str, dict[str, Any]]:
    """Motors of LeRobot's calibration file: `id`, `drive_mode`, `homing_offset`, their range.

    Raises LogError if the file is none.
    """
    try:
        motors = json.loads(Path(path).read_text(encoding="utf-8"))
        return {name: {**m, "homing_offset": int(m["homing_offset"])} for name, m in motors.items()}
    except OSError as error:
        raise LogError(f"cannot read {os.fspath(path)!r}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise LogError(
            f"{os.fspath(path)} is no calibration of LeRobot: expected motors with `homing_offset`"
        ) from None


def homed(
    motors: Mapping[str, Mapping[str, Any]], offsets: Mapping[str, float]
) -> tuple[str, dict[str, int]]:
    """A calibration with corrected zeros, as text, and how many ticks each offset changed by.

    offsets : by joint what is added to its logged value [rad]
    Raises OptionError if the motors are not those of the arm, or a zero is out of reach.
    """
    if missing := [name for name in offsets if name not in motors]:
        raise OptionError(
            f"the calibration has the motors {listed(motors)}, not {listed(missing)} of the model"
        )
    ticks = {name: -round(value * TICKS / math.tau) for name, value in offsets.items()}
    new = {name: {**motor} for name, motor in motors.items()}
    for name, change in ticks.items():
        new[name]["homing_offset"] += change
        if abs(new[name]["homing_offset"]) > _REGISTER:
            raise OptionError(
                f"{name}: its homing offset would be {new[name]['homing_offset']} ticks, at most "
                f"{_REGISTER} are possible: put its horn on a tooth further"
            )
    return json.dumps(new, indent=4) + "\n", ticks
