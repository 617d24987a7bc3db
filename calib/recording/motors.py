"""Motors of LeRobot arms: the calibration file that turns their readings into angles.

`calibration.json` has for each motor the ends of its range in ticks and its homing offset, as
huggingface/lerobot writes them (src/lerobot/motors/motors_bus.py).  Ticks become degrees from the
middle of that range, or shares of it from -100 to 100.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common.arrays import Array
from ..errors import LogError

TICKS = 4096
"""Ticks of a Feetech motor in a turn."""

WHOLE_SHARE = 100.0  # what LeRobot calls either end of a motor's range


@dataclass(frozen=True)
class Motor:
    """One motor of `calibration.json`."""

    # [ticks], what the motor takes off its encoder's position
    homing_offset: int
    range_min: int  # [ticks], lower end of its range
    range_max: int  # [ticks]
    drive_mode: int = 0  # 1 turns the sign of shares, not that of degrees

    def angle(self, share: Array) -> Array:
        """Return angles [rad] from the middle of the range for shares of it, -100 to 100."""
        ticks = share / (2 * WHOLE_SHARE) * (self.range_max - self.range_min)
        if self.drive_mode:
            ticks = -ticks
        angle: Array = ticks * math.tau / (TICKS - 1)
        return angle


@dataclass(frozen=True)
class Motors:
    """The motors of an arm, by name, and the document that they stand in."""

    motors: Mapping[str, Motor]
    document: Mapping[str, Mapping[str, Any]]

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Motors:
        """Read a `calibration.json`.  Raises LogError in one line if the file is none."""
        label = os.fspath(path)
        try:
            document = json.loads(Path(path).read_text(encoding="utf-8"))
            motors = {
                str(name): _motor(entry) for name, entry in document.items()
            }
        except OSError as error:
            raise LogError(f"cannot read {label!r}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
            raise LogError(
                f"{label} is no calibration of LeRobot: expected motors with `homing_offset`, "
                "`range_min` and `range_max`"
            ) from None
        return cls(motors, document)

    def angles(self, names: tuple[str, ...], shares: Array) -> Array:
        """Return joint values (n, k) [rad] for shares (n, k) of these motors' ranges."""
        missing = [name for name in names if name not in self.motors]
        if missing:
            raise LogError(
                f"the calibration has the motors {', '.join(self.motors)}, not {missing[0]}"
            )
        angles = shares.copy()
        for column, name in enumerate(names):
            angles[:, column] = self.motors[name].angle(shares[:, column])
        return angles


def _motor(entry: Mapping[str, Any]) -> Motor:
    numbers = {
        key: int(entry[key])
        for key in ("homing_offset", "range_min", "range_max")
    }
    return Motor(**numbers, drive_mode=int(entry.get("drive_mode", 0)))
