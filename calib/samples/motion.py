"""Motion: the joints row by row, and what of their way matters for where the tip stands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from .joint_values import directions

if TYPE_CHECKING:
    from .samples import Samples


@dataclass(frozen=True, eq=False)
class Motion:
    """Joint values, with the side from which each joint came and when, where that is known.

    Examples
    --------
    >>> from calib.samples.samples import Samples
    >>> samples = Samples([[0.0], [1.0], [0.5]], [[1, 0], [0, 1], [1, 1]], ("hinge",))
    >>> Motion.of(samples).side.tolist()
    [[0.0], [1.0], [-1.0]]
    """

    q: Array  # (n, dof), joint values [rad or m]
    # (n, dof), sign of each joint's last motion: 1, -1, or 0 where it is not known
    side: Array | None = None
    time: Array | None = None  # (n,), when each row was taken [s]

    def __len__(self) -> int:
        return len(self.q)

    @staticmethod
    def of(samples: Samples) -> Motion:
        """Return the motion of a log, whose rows are in the order in which the arm went."""
        return Motion(samples.q, directions(samples.q), samples.time)

    def take(self, index: ArrayLike | slice) -> Motion:
        """Return the rows that `index` picks, each with the side that it has here."""
        rows = index if isinstance(index, slice) else np.asarray(index)
        side = None if self.side is None else self.side[rows]
        time = None if self.time is None else self.time[rows]
        return replace(self, q=self.q[rows], side=side, time=time)
