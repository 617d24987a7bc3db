"""Kohonen's batch map: it goes to the fixed points of eq. 2, in a fortieth of the time.

Where eq. 2 comes to rest each node is the mean of all samples, weighted by h of eq. 3.  Each epoch
puts the nodes there for the winners as they are.  `python benchmarks/map_readouts.py rules
--samples 20000`, 30x30 nodes, maps and links: eq. 1 to 4 sample by sample 15.1 s, quantization
error 0.0103; batch from a random start 0.46 s, 0.0102; coarse to fine 0.22 s, 0.0099; a VDSOM
16.2 s and 0.32 s.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .density import Gain, Visit
from .epoch import Epoch, topographic_error
from .map import nearest_nodes, search_tree
from .neighbourhood import moved
from .schedule import Stage
from .start import spread_out

_CELLS = 65_535  # parts of the unit box by which samples are sorted


def learn_batch(
    u: Array,
    stages: list[Stage],
    gain: Gain | None,
    rng: np.random.Generator,
    residual: Array | None = None,
) -> Iterator[Epoch]:
    """Train stage after stage; yields after each epoch.

    The fixed points of a stage without `step` are those of eq. 2: each node is the mean of
    all samples, weighted by the neighbourhood h (eq. 3) of their winners and, for a VDSOM, by
    their gain.
    """
    order = _by_place(u)
    u = u[order]
    lattice = stages[0].lattice
    weights = rng.random((lattice.size, u.shape[1]))
    if not stages[0].final:
        weights = spread_out(u, lattice)
    per_node = len(u) / stages[-1].lattice.size
    for stage in stages:
        if stage.lattice != lattice:
            weights = lattice.resample(weights, stage.lattice)
        lattice = stage.lattice
        drawn = _some(u, stage.samples, rng)
        some, rows = u[drawn], order[drawn]
        back = np.argsort(rows)  # a gain sees samples in the log's order, not in that of places
        wrong = None if residual is None else residual[rows[back]]
        for k, sigma in enumerate(stage.sigma):
            tree, share = search_tree(weights), (k + 1) / len(stage.sigma)
            distances, index = nearest_nodes(tree, some)  # eq. 1
            distance, winner = distances[:, 0], index[:, 0]
            g = np.ones(len(some))
            if gain is not None and stage.progress is not None:
                first, last = stage.progress
                t, by, far = first + (last - first) * share, winner[back], distance[back]
                visit = Visit(t, by, far, weights, lattice, wrong, float(sigma), per_node)
                g[back] = gain(visit)
            topographic = topographic_error(some, tree, lattice)
            # of each node: sum of the samples that it won, and their weight
            columns = [*(g * c for c in some.T), g]
            won = [np.bincount(winner, c, lattice.size) for c in columns]
            sums = np.stack(won, axis=1, dtype=float)
            weights = moved(weights, sums, lattice, float(sigma), stage.step)
            error = float(distance.mean())
            yield Epoch(weights, lattice, float(sigma), error, topographic, len(some))


def _by_place(u: Array) -> NDArray[np.intp]:
    """An order of the samples in which those close to each other follow each other.

    Their winners then lie close in memory, and are found in three quarters of the time.
    """
    per_axis = int(_CELLS ** (1 / u.shape[1]))
    cell = np.zeros(len(u), dtype=np.uint16)
    for c in u.T:
        cell = cell * np.uint16(per_axis) + (np.clip(c, 0.0, 0.999) * per_axis).astype(np.uint16)
    return np.argsort(cell, kind="stable")  # in linear time, as they have 16 bits


def _some(u: Array, n: int, rng: np.random.Generator) -> NDArray[np.intp] | slice:
    """Which samples are shown: at most `n`, drawn at random, in the same order."""
    if n >= len(u):
        return slice(None)
    return np.sort(rng.choice(len(u), n, replace=False, shuffle=False))
