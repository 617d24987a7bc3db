"""Motion: the joints row by row, and what of their way matters for where the tip stands."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array

_STILL = 1e-9  # of a joint's largest move: less is no motion


@dataclass(frozen=True, eq=False)
class Motion:
    """Joint values, with the side from which each joint came and when, where that is known."""

    q: Array  # (n, dof), joint values [rad or m]
    # (n, dof), sign of each joint's last motion: 1, -1, or 0 where it is not known
    side: Array | None = None
    time: Array | None = None  # (n,), when each row was taken [s]

    def __len__(self) -> int:
        return len(self.q)

    def stood(self, play: Array) -> Array:
        """Where joints with half a play (dof,) stood, (n, dof) [rad or m]."""
        return self.q if self.side is None else self.q - play * self.side

    def take(self, index: ArrayLike | slice) -> Motion:
        """Return the rows that `index` picks, each with the side that it has here."""
        rows = index if isinstance(index, slice) else np.asarray(index)
        side = None if self.side is None else self.side[rows]
        time = None if self.time is None else self.time[rows]
        return replace(self, q=self.q[rows], side=side, time=time)


def directions(q: Array) -> Array:
    """Sign of the last motion of each joint (n, dof), for joint values in the order of motion.

    1 or -1; 0 before a joint's first motion, where it is not known.
    """
    step = np.diff(q, axis=0, prepend=q[:1])
    least = _STILL * np.abs(step).max(axis=0, initial=0.0)
    sign = np.where(np.abs(step) > least, np.sign(step), 0.0)
    # a joint that rests keeps the side from which it came
    moved = np.where(sign != 0.0, np.arange(len(q))[:, None], 0)
    latest = np.maximum.accumulate(moved, axis=0)
    return np.take_along_axis(sign, latest, axis=0)
