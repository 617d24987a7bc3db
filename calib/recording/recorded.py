"""A log made of pictures or a video: rows, unit, noise, and what was left out."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..samples.tables import write_table

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recorded:
    """Joints and what a camera saw with them.

    Attributes
    ----------
    q : (n, joints) array [rad or m]
        Values of the joints named in `joint_names`.
    x : (n, 2) or (n, 3) array [unit]
        The tag's centre, in "m", or in "px" without a reference.
    noise, common : float [unit]
        Standard deviation of a row along each axis, and the part of it that all rows share: how
        well the reference was found.
    pixels : (n, 2) array [px]
        Where the tag was seen.
    source : dict
        What it was made of, as plain values: `Recorded.write` keeps it with the log.
    quaternion : (n, 4) array or None
        Orientation of the tag, x, y, z, w.
    time : (n,) array [s] or None
        Times since the first row; of pictures their names in `pictures` instead.
    dropped : dict of str to int
        Why rows are missing, and how many.
    """

    joint_names: tuple[str, ...]
    q: Array
    x: Array
    unit: str
    noise: float
    pixels: Array
    common: float = 0.0
    source: Mapping[str, Any] = field(default_factory=dict)
    quaternion: Array | None = None
    time: Array | None = None
    pictures: tuple[str, ...] | None = None
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.q)

    def about(self) -> dict[str, Any]:
        """Return what stands above the columns: unit, noise and source."""
        return {
            "unit": self.unit,
            "noise": self.noise,
            "noise_of_reference": self.common,
            "dropped": dict(self.dropped),
            **self.source,
        }

    def columns(self) -> dict[str, Array]:
        """Return the columns by name."""
        named = {name: self.q[:, k] for k, name in enumerate(self.joint_names)}
        named |= {
            axis: self.x[:, k] for k, axis in zip(range(self.x.shape[1]), "xyz", strict=False)
        }
        if self.quaternion is not None:
            names = ("qx", "qy", "qz", "qw")
            named |= {name: self.quaternion[:, k] for k, name in enumerate(names)}
        if self.time is not None:
            named["time"] = self.time
        return named

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write it as a log: CSV with one line of comment, or Parquet with metadata."""
        write_table(path, self.columns(), about=self.about())


def told(reasons: Mapping[str, int], what: str) -> list[str]:
    """Say what was left out, and why."""
    return [f"{count} {what} left out: {why}" for why, count in reasons.items() if count]
