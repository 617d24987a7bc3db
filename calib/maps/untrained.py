"""Nodes that no rule has moved: what a trained map has to beat.

An even grid, random nodes and training rows as nodes.  The first is a lattice; the others are
joined to their nearest neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from .lattice import Graph, Lattice
from .map import Epoch, nearest_nodes, search_tree

KINDS = ("grid", "random", "rows")
"""Names in ``map=``."""

_JOINED = 4  # nearest neighbours of a node without a lattice
_JITTER = 1e-7  # of the unit box: repeated rows make no two nodes in one place


def place(kind: str, u: Array, lattice: Lattice, rng: np.random.Generator) -> Iterator[Epoch]:
    """Nodes of one kind, as a single epoch: "grid", "random" or "rows" drawn from `u` (n, d)."""
    joined: Lattice | Graph = lattice
    if kind == "grid":
        weights = np.full((lattice.size, u.shape[1]), 0.5)
        weights[:, : lattice.dim] = (lattice.positions() + 0.5) / np.array(lattice.shape)
    else:
        if kind == "random":
            weights = rng.random((lattice.size, u.shape[1]))
        else:
            drawn = rng.choice(len(u), lattice.size, replace=len(u) < lattice.size)
            weights = u[drawn] + _JITTER * rng.standard_normal((lattice.size, u.shape[1]))
        joined = neighbours(weights)
    error = float(nearest_nodes(search_tree(weights), u)[0].mean())
    yield Epoch.of(u, weights, joined, 0.0, error)


def neighbours(weights: Array) -> Graph:
    """The graph that joins each node (nodes, d) to its 4 nearest."""
    n, k = len(weights), min(_JOINED, len(weights) - 1)
    near = nearest_nodes(search_tree(weights), weights, k + 1)[1][:, 1:]
    return Graph.of(n, np.stack([np.repeat(np.arange(n), k), near.ravel()], axis=1))
