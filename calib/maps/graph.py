"""The graph of a map without a lattice: which of its nodes are joined."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index, Shape


@dataclass(frozen=True, eq=False)
class Graph:
    """Nodes joined by edges, as a growing neural gas leaves them.

    It answers what a :class:`~calib.maps.lattice.Lattice` answers, but for positions:
    its nodes stand nowhere but in the space that they have learned.
    """

    size: int  # number of nodes
    # (m, 2), the edges, each once, the smaller node first, in ascending order
    pairs: Annotated[Index, Shape("edges", 2)]

    @staticmethod
    def of(size: int, pairs: NDArray[np.intp]) -> Graph:
        """The graph of pairs (m, 2) in any order, which may repeat."""
        return Graph(size, np.unique(np.sort(pairs, axis=1), axis=0))

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of nodes, as the shape of a lattice of no particular form."""
        return (self.size,)

    @cached_property
    def degree(self) -> NDArray[np.intp]:
        """Number of edges of each node, (size,)."""
        return np.bincount(self.pairs.ravel(), minlength=self.size)

    def neighbours(self) -> Array:
        """Edges of each node over those of most nodes inside, (size,), at most 1.

        "Most" is the upper quartile: nodes at the border have fewer.
        """
        most = max(float(np.quantile(self.degree, 0.75)), 1.0)
        return np.minimum(1.0, self.degree / most)

    def edges(self) -> NDArray[np.intp]:
        """Pairs of joined nodes, (m, 2)."""
        return self.pairs

    def adjacent(self, i: NDArray[np.intp], j: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether nodes `i` and `j` are the same or joined, (n,)."""
        low, high = np.minimum(i, j), np.maximum(i, j)
        key = self.pairs[:, 0] * self.size + self.pairs[:, 1]
        return np.asarray((low == high) | np.isin(low * self.size + high, key))
