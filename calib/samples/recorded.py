"""A log that was made of a bag, pictures or a video: its rows, and what was left out and why."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..common.arrays import Array
from .roles import log_columns
from .tables import write_table


@dataclass(frozen=True, eq=False)
class Recorded:
    """Joints and what a sensor saw with them."""

    joint_names: tuple[str, ...]
    q: Array  # values of the joints named in `joint_names` (n, joints) [rad or m]
    x: Array  # positions, of a camera the tag's centre (n, 2) or (n, 3) [unit]
    unit: str = "m"  # "px" for pixels
    # of pictures and videos the standard deviation of a row along each axis, and the part of it
    # that all rows share: how well the reference was found [unit]
    noise: float = 0.0
    common: float = 0.0
    pixels: Array = field(default_factory=lambda: np.empty((0, 2)))  # of the tag (n, 2) [px]
    # what the rows were made of, as plain values: `Recorded.write` keeps it with the log
    source: Mapping[str, Any] = field(default_factory=dict)
    quaternion: Array | None = None  # orientation, x, y, z, w (n, 4)
    covariance: Array | None = None  # of position and of a small turn (n, 6, 6) [unit, rad]
    # times since the first row; of pictures their names in `pictures` instead (n,) [s]
    time: Array | None = None
    pictures: tuple[str, ...] | None = None
    episodes: Array | None = None  # (n,), the series that each row is of
    dropped: Mapping[str, int] = field(default_factory=dict)  # why rows are missing, and how many
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.q)

    def about(self) -> dict[str, Any]:
        """Return what stands above the columns: unit and source, and of pictures their noise."""
        about = {"unit": self.unit, **self.source} if self.noise or self.source else {}
        if self.noise:
            noise = {"noise": self.noise, "noise_of_reference": self.common}
            about = {"dropped": dict(self.dropped), **noise, **about}
        return about

    def columns(self) -> dict[str, Array]:
        """Return the columns by name."""
        time = {} if self.time is None else {"time": self.time}
        series = {} if self.episodes is None else {"episode": self.episodes}
        made = self.joint_names, self.q, self.x, self.quaternion, self.covariance
        return log_columns(*made) | time | series

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write it as a log: CSV with one line of comment, or Parquet with metadata."""
        write_table(path, self.columns(), about=self.about())


def told(reasons: Mapping[str, int], what: str) -> list[str]:
    """Say what was left out, and why."""
    return [f"{count} {what} left out: {why}" for why, count in reasons.items() if count]
