"""Kohonen's batch map: it goes to the fixed points of eq. 2, some fifty times sooner.

Where eq. 2 comes to rest each node is the mean of all samples, weighted by h of eq. 3.  Each epoch
puts the nodes there for the winners as they are.  It starts from a coarse lattice spread over the
samples, which goes to the same fixed points as a random start.  `python benchmarks/map_readouts.py
rules --samples 20000`: sample by sample 17.1 s, from a random start 0.60 s, coarse to fine 0.21 s.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .density import Gain, Visit
from .lattice import REACH, Lattice
from .map import Epoch, nearest_nodes, search_tree, topographic_error
from .schedule import Stage

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
    if len(stages) > 1:
        weights = spread_out(u, lattice)
    per_node = len(u) / stages[-1].lattice.size
    for stage in stages:
        if stage.lattice != lattice:
            weights = lattice.resample(weights, stage.lattice)
        lattice = stage.lattice
        drawn: NDArray[np.intp] | slice = slice(None)
        if stage.samples < len(u):
            drawn = np.sort(rng.choice(len(u), stage.samples, replace=False, shuffle=False))
        some, rows = u[drawn], order[drawn]
        back = np.argsort(rows)  # a gain sees samples in the log's order, not in that of places
        wrong = None if residual is None else residual[rows[back]]
        for k, sigma in enumerate(stage.sigma.tolist()):
            tree, share = search_tree(weights), (k + 1) / len(stage.sigma)
            distances, index = nearest_nodes(tree, some)  # eq. 1
            distance, winner = distances[:, 0], index[:, 0]
            g = np.ones(len(some))
            if gain is not None and stage.progress is not None:
                first, last = stage.progress
                t, by, far = first + (last - first) * share, winner[back], distance[back]
                g[back] = gain(Visit(t, by, far, weights, lattice, wrong, sigma, per_node))
            topographic = topographic_error(some, tree, lattice)
            # of each node: sum of the samples that it won, and their weight
            columns = [*(g * c for c in some.T), g]
            won = [np.bincount(winner, c, lattice.size) for c in columns]
            sums = np.stack(won, axis=1, dtype=float)
            weights = moved(weights, sums, lattice, sigma, stage.step)
            yield Epoch(weights, lattice, sigma, float(distance.mean()), topographic, len(some))


def _by_place(u: Array) -> NDArray[np.intp]:
    """An order in which close samples follow each other: their winners are found sooner."""
    per_axis = int(_CELLS ** (1 / u.shape[1]))
    cell = np.zeros(len(u), dtype=np.uint16)
    for c in u.T:
        cell = cell * np.uint16(per_axis) + (np.clip(c, 0.0, 0.999) * per_axis).astype(np.uint16)
    return np.argsort(cell, kind="stable")  # in linear time, as they have 16 bits


def spread_out(u: Array, lattice: Lattice) -> Array:
    """Nodes (size, d) at even places of the unit box, or along the main axes of samples (n, d).

    A lattice with fewer axes than the space has lies in the plane in which the samples vary most.
    """
    place = (lattice.positions() + 0.5) / np.array(lattice.shape)
    if lattice.dim >= u.shape[1]:
        return np.ascontiguousarray(place[:, : u.shape[1]])
    middle = u.mean(axis=0)
    axes = np.linalg.svd(u - middle, full_matrices=False)[2][: lattice.dim]
    # of an even spread the half width is sqrt(3) standard deviations
    wide = np.sqrt(3.0) * np.std((u - middle) @ axes.T, axis=0)
    return np.asarray(middle + (2.0 * place - 1.0) * wide @ axes)


def spread(sums: Array, lattice: Lattice, sigma: float) -> Array:
    """Sum over all nodes i of h_ji times the rows of `sums` (size, ...), one axis after another."""
    from scipy.ndimage import correlate1d

    grid = sums.reshape(*lattice.shape, -1)
    for axis, n in enumerate(lattice.shape):
        reach = min(int(REACH * sigma) + 1, n - 1)
        h = np.exp(np.arange(-reach, reach + 1) ** 2 / (-2.0 * sigma * sigma))  # eq. 3
        grid = correlate1d(grid, h, axis, mode="constant")
    return np.asarray(grid.reshape(sums.shape))


def moved(weights: Array, sums: Array, lattice: Lattice, sigma: float, step: float | None) -> Array:
    """Where the nodes (size, d) go after an epoch.

    Kohonen's batch rule puts each node at the mean of all samples, weighted by the
    neighbourhood h of their winners: what eq. 2 comes to rest at.  With a `step` the
    nodes follow those of the winners instead,

        w_j += step sum_s h_ji (x_s - w_i) / sum_s h_ji,   i the winner of s,

    which does not draw the border inwards.  It rests where each node is the mean of the
    samples that it wins; a step of 2 or more would overshoot.

    sums : (size, d + 1), sum of the samples that each node won, and their number or weight
    """
    if step is not None:
        own = sums[:, -1:]
        sums = np.concatenate([step * (sums[:, :-1] - own * weights), own], axis=1)
    met = spread(sums, lattice, sigma)
    count = met[:, -1:]
    reached = count > 1e-12 * count.max()
    mean = met[:, :-1] / np.where(reached, count, 1.0)
    return np.where(reached, mean if step is None else weights + mean, weights)
