"""Kohonen's batch map: it goes to the fixed points of eq. 2, some fifty times sooner.

`python benchmarks/map_readouts.py rules --samples 20000`: sample by sample 17.1 s, from a random
start 0.60 s, coarse lattices first 0.21 s; with the gain of the border 20.8, 0.40 and 0.34 s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from ..common.arrays import Array, Index
from .density import Gain, Visit
from .lattice import REACH, Lattice
from .map import Epoch, nearest_nodes, search_tree, topographic_error

Density = Literal["even", "varying", "growing"]
"""How a gain acts: not, on the full lattice alone, or on the coarse ones too (the default)."""

_CELLS = 65_535  # parts of the unit box by which samples are sorted
_LAST, _LAST_VARYING = 0.4, 1.5  # last radii of the full lattice [nodes]
_COARSEST = 64  # nodes of the lattice that is ordered first
_GROWTH = 10.0  # the next one has at most so many times the nodes
_PER_NODE = 10  # samples that a coarse lattice is shown per epoch and node
_STEP = 1.5  # see Stage.step
_FIRST_GROWING, _EPOCHS_GROWING = 3.0, 5  # first radius [nodes] and epochs of the full lattice
_GROWN = 0.5  # t / T after the coarse lattices


def decay(start: float, end: float, n: int) -> Array:
    """`n` values that decay exponentially from `start` to `end` (eq. 4)."""
    return start * (end / start) ** np.linspace(0.0, 1.0, n) if n > 1 else np.array([end])


@dataclass(frozen=True)
class Stage:
    """Some epochs on one lattice; the last stage trains the one that is kept."""

    lattice: Lattice
    sigma: Array  # (epochs,) [nodes], neighbourhood radius of each epoch
    # the nodes follow the winners' steps, times this (below 2, which would overshoot); without it
    # Kohonen's batch rule, see :func:`moved`
    step: float | None = None
    # t / T of a varying density before and after this stage; without it the density does not vary
    progress: tuple[float, float] | None = None


def coarse_to_fine(
    lattice: Lattice,
    epochs: int | None = None,
    sigma: tuple[float, float] | None = None,
    density: Density = "even",
) -> list[Stage]:
    """Stages that order a coarse lattice and refine it up to `lattice`.

    A coarse lattice settles with less work and fewer folds than a fine one, which starts from its
    interpolation with a small radius.  The last stage is eq. 2; with `epochs` or `sigma` it is the
    only one, from a random start.  Where the density varies the last radius is wider: a smooth map
    whose border the gain holds in place is more accurate than one that follows each sample.  One
    that grows has its gain on the coarse lattices, where an epoch costs little.
    """
    alone, longest = epochs is not None or sigma is not None, max(lattice.shape)
    last = _LAST_VARYING if density == "varying" or (alone and density == "growing") else _LAST
    if alone:
        start, end = sigma or (max(longest / 2, last), last)
        return [Stage(lattice, decay(start, end, epochs or 20), progress=(0.0, 1.0))]
    growth = lattice.size / _COARSEST
    levels = math.ceil(math.log(growth, _GROWTH)) if growth >= 2 else 0
    coarse = [shrunk(lattice, _COARSEST * growth ** (k / levels)) for k in range(levels)]
    coarse = [small for small in coarse if small.size < lattice.size]
    if not coarse:
        start = max(longest / 2, 1.0)
        return [Stage(lattice, decay(start, min(last, start), 20), progress=(0.0, 1.0))]
    if density == "varying":  # so wide a radius comes next that one coarse lattice will do
        coarse = coarse[:1]
    first = Stage(coarse[0], decay(2.0, 0.7, 8))
    finer = [Stage(small, decay(2.0, 1.5, 6), _STEP) for small in coarse]
    if density == "varying":
        # the gain draws nodes to the border: that takes wide radii and more epochs
        radii = decay(max(2 * last, longest / 5), last, 14)
        return [first, *finer, Stage(lattice, radii, progress=(0.0, 1.0))]
    finer.append(Stage(lattice, np.array([1.5]), _STEP))
    if density == "even":
        return [first, *finer, Stage(lattice, decay(1.0, last, 3), progress=(0.0, 1.0))]
    share = np.linspace(0.0, _GROWN, len(finer) + 1).tolist()
    finer = [replace(s, progress=part) for s, part in zip(finer, pairwise(share), strict=True)]
    side = lattice.size ** (1 / lattice.dim)
    last = float(np.clip(_LAST + 0.22 * math.log2(side / 20), _LAST, 0.8))
    radii = decay(_FIRST_GROWING, last, _EPOCHS_GROWING)
    return [first, *finer, Stage(lattice, radii, progress=(_GROWN, 1.0))]


def shrunk(lattice: Lattice, nodes: float) -> Lattice:
    """A lattice of the same proportions with about `nodes` nodes."""
    factor = (nodes / lattice.size) ** (1 / lattice.dim)
    return Lattice(tuple(max(2, round(s * factor)) for s in lattice.shape))


def learn_batch(
    u: Array,
    stages: list[Stage],
    gain: Gain | None,
    rng: np.random.Generator,
    residual: Array | None = None,
) -> Iterator[Epoch]:
    """Train stage after stage; yields after each epoch.

    In a stage without `step` each node goes to the mean of all samples, weighted by the
    neighbourhood h (eq. 3) of their winners and their gain: the fixed points of eq. 2.
    """
    order = _by_place(u)
    u = u[order]
    lattice, full = stages[0].lattice, stages[-1].lattice
    weights = rng.random((lattice.size, u.shape[1]))
    if len(stages) > 1:
        weights = spread_out(u, lattice)
    for stage in stages:
        if stage.lattice != lattice:
            weights = lattice.resample(weights, stage.lattice)
        lattice = stage.lattice
        drawn, most = np.arange(len(u)), _PER_NODE * lattice.size
        if lattice != full and most < len(u):
            drawn = np.sort(rng.choice(len(u), most, replace=False, shuffle=False))
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
                per_node = len(u) / full.size
                g[back] = gain(Visit(t, by, far, weights, lattice, wrong, sigma, per_node))
            topographic = topographic_error(some, tree, lattice)
            # of each node: sum of the samples that it won, and their weight
            columns = [*(g * c for c in some.T), g]
            won = [np.bincount(winner, c, lattice.size) for c in columns]
            sums = np.stack(won, axis=1, dtype=float)
            weights = moved(weights, sums, lattice, sigma, stage.step)
            yield Epoch(weights, lattice, sigma, float(distance.mean()), topographic)


def _by_place(u: Array) -> Index:
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

    Kohonen's batch rule puts each node at the mean of all samples, weighted by h of their winners.
    With a `step` nodes follow those of the winners instead, w_j += step sum_s h_ji (x_s - w_i) /
    sum_s h_ji, i the winner of s, which does not draw the border inwards.

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
