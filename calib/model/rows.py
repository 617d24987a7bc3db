"""Rows: measurements that a model of a log keeps, for reports, exports and comparisons."""

from __future__ import annotations

from dataclasses import dataclass

from ..common.arrays import Array
from ..common.frozen import ReadOnly

MOST = 5_000
"""Rows that are kept of a longer log, evenly spread over it."""


@dataclass(frozen=True, eq=False)
class Rows(ReadOnly):
    """Measured rows."""

    q: Array  # (n, dof) [rad or m], joint values
    x: Array  # (n, m) [unit], positions

    def __len__(self) -> int:
        return len(self.q)

    @staticmethod
    def of(q: Array, x: Array) -> Rows:
        """At most 5,000 of the rows of a log, evenly spread over it."""
        every = -(-len(q) // MOST)
        return Rows(q[::every].copy(), x[::every].copy())
