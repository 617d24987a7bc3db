"""Batch neural gas: nodes without a lattice, for four joints and more.

A lattice of two or three axes folds into a space of six and quantizes it worse than random
rows do.  A gas has no shape of its own: samples pull their nearest nodes by rank (Martinetz and
Schulten 1991), in batches (Cottrell, Hammer, Hasenfuss and Villmann, Neural Networks 19,
2006), and nodes that are the two nearest of a sample are joined (competitive Hebbian learning).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from .lattice import Graph
from .map import Epoch, nearest_nodes, search_tree
from .schedule import decay

_RANGE = (2.0, 0.1)  # lambda, the rank over which a sample's pull falls by a factor e
_NEAREST = 8  # nodes that a sample pulls; beyond, its pull is below 2 %


def learn_gas(u: Array, nodes: int, epochs: int, rng: np.random.Generator) -> Iterator[Epoch]:
    """Train a gas of `nodes` nodes from rows; yields after each pass over the samples (n, d)."""
    drawn = rng.choice(len(u), nodes, replace=len(u) < nodes)
    weights = u[drawn] + 1e-7 * rng.standard_normal((nodes, u.shape[1]))
    k = min(_NEAREST, nodes)
    columns = np.column_stack([u, np.ones(len(u))]).T
    for reach in decay(*_RANGE, epochs):
        distance, index = nearest_nodes(search_tree(weights), u, k)
        pull = np.exp(-np.arange(k) / reach)
        met = np.zeros((nodes, u.shape[1] + 1))
        for ranked, share in zip(index.T, pull, strict=True):
            won = [np.bincount(ranked, column, nodes) for column in columns]
            met += share * np.stack(won, axis=1)
        known = met[:, -1] > 0.0
        weights = np.where(known[:, None], met[:, :-1] / np.maximum(met[:, -1:], 1e-300), weights)
        graph = Graph.of(nodes, nearest_nodes(search_tree(weights), u, 2)[1])
        yield Epoch.of(u, weights, graph, 0.0, float(distance[:, 0].mean()))
