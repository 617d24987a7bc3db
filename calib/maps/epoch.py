"""Epochs: what every network tells while it trains, and the search for winners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .graph import Graph
from .lattice import Lattice

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_MANY = 4000


@dataclass(frozen=True, eq=False)
class Epoch:
    """The state of a network after one pass over some samples."""

    weights: Array  # (nodes, d), weights of the nodes, in the unit box
    lattice: Lattice | Graph  # how they are joined
    sigma: float  # [nodes], neighbourhood radius of this pass
    error: float  # mean distance of the samples to their winners, in the unit box
    topographic: float  # share of samples whose two nearest nodes are not joined
    shown: int  # samples of this pass


def nearest(tree: cKDTree, u: Array, k: int | list[int] = 1) -> tuple[Array, NDArray[np.intp]]:
    """Distance and index of the nearest node (or nodes) of each sample (eq. 1)."""
    # for a few samples threads take longer to start than to search
    distance, index = tree.query(u, k=k, workers=-1 if len(u) > _MANY else 1)
    return np.asarray(distance), np.asarray(index, dtype=np.intp)


def topographic_error(u: Array, tree: cKDTree, lattice: Lattice | Graph) -> float:
    """Topographic error on some 500 of the samples `u`."""
    index = nearest(tree, u[:: max(1, len(u) // 500)], [1, 2])[1]
    return float(np.mean(~lattice.adjacent(index[:, 0], index[:, 1])))
