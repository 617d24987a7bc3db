"""Epochs: what every network tells while it trains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from .graph import Graph
from .lattice import Lattice
from .map import nearest_nodes, search_tree

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


@dataclass(frozen=True, eq=False)
class Epoch:
    """The state of a network after one pass over some samples."""

    weights: Array  # (nodes, d), weights of the nodes, in the unit box
    lattice: Lattice | Graph  # how they are joined
    sigma: float  # [nodes], neighbourhood radius of this pass
    error: float  # mean distance of the samples to their winners, in the unit box
    topographic: float  # share of samples whose two nearest nodes are not joined
    shown: int  # samples of this pass

    @staticmethod
    def of(u: Array, weights: Array, lattice: Lattice | Graph, sigma: float, error: float) -> Epoch:
        """The state after a pass over all samples `u` (n, d)."""
        topographic = topographic_error(u, search_tree(weights), lattice)
        return Epoch(weights, lattice, sigma, error, topographic, len(u))

    @property
    def row(self) -> tuple[int, float, float, float]:
        """What a map remembers of it, columns as :data:`calib.maps.map.HISTORY`."""
        return len(self.weights), self.sigma, self.error, self.topographic


def topographic_error(u: Array, tree: cKDTree, lattice: Lattice | Graph) -> float:
    """Topographic error on some 500 of the samples `u`."""
    index = nearest_nodes(tree, u[:: max(1, len(u) // 500)], 2)[1]
    return float(np.mean(~lattice.adjacent(index[:, 0], index[:, 1])))
