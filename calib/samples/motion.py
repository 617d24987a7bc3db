"""Motion: the joints row by row, and what of their way matters for where the tip stands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Index
from .joint_values import directions

_SAME = 6  # decimals [rad or m] to which joints at one pose read the same

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

    @property
    def pose_index(self) -> Index:
        """Number of the pose that each row stands at, (n,): rows at one pose share it."""
        return pose_index(self.q)

    def take(self, index: ArrayLike | slice) -> Motion:
        """Return the rows that `index` picks, each with the side that it has here."""
        rows = index if isinstance(index, slice) else np.asarray(index)
        side = None if self.side is None else self.side[rows]
        time = None if self.time is None else self.time[rows]
        return replace(self, q=self.q[rows], side=side, time=time)


def pose_index(q: Array) -> Index:
    """Number of the pose of each row (n,), counted in the order in which joints (n, dof) show them.

    However often it is read, a pose is one measurement of the arm.
    """
    _, first, index = np.unique(q.round(_SAME), axis=0, return_index=True, return_inverse=True)
    order = np.empty(len(first), dtype=np.intp)
    order[np.argsort(first)] = np.arange(len(first))
    return order[index.ravel()]
