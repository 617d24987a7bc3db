"""Rows: measurements that a model of a log keeps, for reports, exports and comparisons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.frozen import ReadOnly

Array = NDArray[np.float64]

MOST = 5_000
"""Rows that are kept of a longer log, evenly spread over it."""


@dataclass(frozen=True, eq=False)
class Rows(ReadOnly):
    """Measured rows.

    Attributes
    ----------
    q : (n, dof) array [rad or m]
        Joint values.
    x : (n, m) array [unit]
        Positions.
    """

    q: Array
    x: Array

    def __len__(self) -> int:
        return len(self.q)

    @staticmethod
    def of(q: Array, x: Array) -> Rows:
        """At most 5,000 of the rows of a log, evenly spread over it."""
        every = -(-len(q) // MOST)
        return Rows(q[::every].copy(), x[::every].copy())
