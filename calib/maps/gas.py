"""Batch neural gas: nodes without a lattice, for four joints and more.

A lattice of two or three axes folds into a space of six and quantizes it worse than random
rows do.  A gas has no shape of its own: samples pull their nearest nodes by rank (Martinetz and
Schulten 1991), in batches (Cottrell, Hammer, Hasenfuss and Villmann, Neural Networks 19,
2006), and nodes that are the two nearest of a sample are joined (competitive Hebbian learning).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .density import Gain, Visit
from .epoch import Epoch
from .graph import Graph
from .map import nearest, search_tree
from .schedule import exponential

EPOCHS = 8
"""Passes over the samples: it starts from rows, which are spread as they are."""

_RANGE = (2.0, 0.1)  # lambda, the rank over which a sample's pull falls by a factor e
_NEAREST = 8  # nodes that a sample pulls; beyond, its pull is below 2 %


def learn(
    u: Array, nodes: int, gain: Gain | None, epochs: int, rng: np.random.Generator
) -> Iterator[Epoch]:
    """Train a gas of `nodes` nodes from rows; yields after each pass over the samples (n, d).

    A gain is a factor on each sample's pull; see :func:`calib.maps.online.learn`.
    """
    drawn = rng.choice(len(u), nodes, replace=len(u) < nodes)
    weights = u[drawn] + 1e-7 * rng.standard_normal((nodes, u.shape[1]))
    k = min(_NEAREST, nodes)
    columns = np.column_stack([u, np.ones(len(u))])
    for epoch, reach in enumerate(exponential(*_RANGE, epochs)):
        distance, index = nearest(search_tree(weights), u, k)
        pull = np.exp(-np.arange(k) / reach)
        share = np.ones(len(u))
        if gain is not None:
            graph = joined(index, nodes)
            visit = Visit((epoch + 1) / epochs, index[:, 0], distance[:, 0], weights, graph)
            share = gain(visit)
        met = np.zeros((nodes, u.shape[1] + 1))
        for rank in range(k):
            for c, column in enumerate(columns.T):
                met[:, c] += pull[rank] * np.bincount(index[:, rank], share * column, nodes)
        known = met[:, -1] > 0.0
        weights = np.where(known[:, None], met[:, :-1] / np.maximum(met[:, -1:], 1e-300), weights)
        index = nearest(search_tree(weights), u, 2)[1]
        yield Epoch(weights, joined(index, nodes), 0.0, float(distance[:, 0].mean()), 0.0, len(u))


def joined(index: NDArray[np.intp], nodes: int) -> Graph:
    """The graph of the nodes that are the two nearest of a sample (n, 2 or more)."""
    return Graph(nodes, np.unique(np.sort(index[:, :2], axis=1), axis=0))
