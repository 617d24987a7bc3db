"""Kohonen's batch map: it goes to the fixed points of eq. 2, some fifty times sooner.

`python benchmarks/map_readouts.py rules --samples 20000`: sample by sample 17.1 s, from a random
start 0.60 s, coarse lattices first 0.21 s; with the gain of the border 20.8, 0.40 and 0.34 s.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from ..common.arrays import Array, Index
from ..common.rows import group_sums
from .density import Gain, Visit
from .lattice import REACH, Lattice
from .map import (
    Epoch,
    folded_share,
    nearest_nodes,
    search_tree,
    shown_step,
    topographic_error,
)
from .settings import BATCH

Density = Literal["even", "varying", "growing"]
"""How a gain acts: not, on the full lattice alone, or on the coarse ones too (the default)."""


def decay(
    start: float,
    end: float,
    n: int,
) -> Array:
    """`n` values that decay exponentially from `start` to `end` (eq. 4)."""
    if n <= 1:
        return np.array([end])
    return start * (end / start) ** np.linspace(0.0, 1.0, n)


@dataclass(frozen=True)
class Stage:
    """Some epochs on one lattice; the last stage trains the one that stays."""

    lattice: Lattice
    sigma: Array  # (epochs,) [nodes], neighbourhood radius of each epoch
    # the nodes follow the winners' steps, times this (below 2, which would overshoot); without it
    # Kohonen's batch rule, see :func:`next_weights`
    step: float | None = None
    # t / T of a varying density before and after this stage; without it the density does not vary
    progress: tuple[float, float] | None = None

    @property
    def times(self) -> list[float | None]:
        """Time t / T of a varying density in each epoch; None where it does not vary."""
        epochs = len(self.sigma)
        if self.progress is None:
            return [None] * epochs
        first, last = self.progress
        shares = [epoch / epochs for epoch in range(1, epochs + 1)]
        return [first + (last - first) * share for share in shares]


def coarse_to_fine(
    lattice: Lattice,
    epochs: int | None,
    sigma: tuple[float, float] | None,
    density: Density,
) -> list[Stage]:
    """Stages that order a coarse lattice and refine it up to `lattice`.

    A coarse lattice settles with less work and fewer folds than a fine one, which starts from its
    interpolation with a small radius.  The last stage is eq. 2; with `epochs` or `sigma` it is the
    only one, from a random start.
    """
    whole = max(lattice.shape) / 2
    coarse = _coarse_lattices(lattice)
    if epochs is not None or sigma is not None:
        last = BATCH.last_radius
        if density != "even":
            last = BATCH.last_radius_varying
        first, last = sigma or (max(whole, last), last)
        return [_alone(lattice, decay(first, last, epochs or 20))]
    if not coarse:
        last = BATCH.last_radius
        if density == "varying":
            last = BATCH.last_radius_varying
        radii = decay(whole, min(last, whole), 20)
        return [_alone(lattice, radii)]
    ordered = Stage(coarse[0], decay(2.0, 0.7, 8))
    refined = {"even": _evenly, "varying": _varying, "growing": _growing}
    return [ordered, *refined[density](lattice, coarse)]


def _evenly(lattice: Lattice, coarse: list[Lattice]) -> list[Stage]:
    """Stages after the first whose density does not vary."""
    last = _alone(lattice, decay(1.0, BATCH.last_radius, 3))
    return [*_refinement(lattice, coarse), last]


def _varying(lattice: Lattice, coarse: list[Lattice]) -> list[Stage]:
    """Stages after the first with a gain on the full lattice alone.

    The gain draws nodes to the border: that takes wide radii and more epochs, so wide that one
    coarse lattice will do; at the end a smooth map whose border the gain holds in place is more
    accurate than one that follows each sample.
    """
    last = BATCH.last_radius_varying
    first = max(2 * last, max(lattice.shape) / 5)
    radii = decay(first, last, 14)
    refined = _refinement(lattice, coarse)[0]
    return [refined, _alone(lattice, radii)]


def _growing(lattice: Lattice, coarse: list[Lattice]) -> list[Stage]:
    """Stages after the first with a gain that grows on the coarse lattices.

    An epoch costs little there.
    """
    stages = _refinement(lattice, coarse)
    ends = len(stages) + 1
    times = np.linspace(0.0, BATCH.grown, ends).tolist()
    growing = [
        replace(stage, progress=span)
        for stage, span in zip(stages, pairwise(times), strict=True)
    ]
    side = lattice.size ** (1 / lattice.dim)
    wider = BATCH.last_radius + 0.22 * math.log2(side / 20)
    last = float(np.clip(wider, BATCH.last_radius, 0.8))
    radii = decay(BATCH.first_radius_growing, last, BATCH.epochs_growing)
    full = Stage(lattice, radii, progress=(BATCH.grown, 1.0))
    return [*growing, full]


def _refinement(lattice: Lattice, coarse: list[Lattice]) -> list[Stage]:
    """Stages of coarse lattices, and one of the full one, that follow the winners' steps."""
    radii = decay(2.0, 1.5, 6)
    finer = [Stage(small, radii, BATCH.step) for small in coarse]
    full = Stage(lattice, np.array([1.5]), BATCH.step)
    return [*finer, full]


def _alone(lattice: Lattice, radii: Array) -> Stage:
    """A stage of Kohonen's batch rule that sees the whole growth of a varying density."""
    return Stage(lattice, radii, progress=(0.0, 1.0))


def _coarse_lattices(lattice: Lattice) -> list[Lattice]:
    """Lattices of the same proportions up to, and without, the full one; none of a small one."""
    growth = lattice.size / BATCH.coarsest
    if growth < 2:
        return []
    levels = math.ceil(math.log(growth, BATCH.growth))
    coarse = [
        _smaller_lattice(lattice, BATCH.coarsest * growth ** (level / levels))
        for level in range(levels)
    ]
    return [small for small in coarse if small.size < lattice.size]


def _smaller_lattice(lattice: Lattice, nodes: float) -> Lattice:
    """A lattice of the same proportions with about `nodes` nodes."""
    factor = (nodes / lattice.size) ** (1 / lattice.dim)
    sides = [round(side * factor) for side in lattice.shape]
    return Lattice(tuple(max(2, side) for side in sides))


def learn_batch(
    u: Array,
    stages: list[Stage],
    gain: Gain | None,
    rng: np.random.Generator,
    residual: Array | None,
) -> Iterator[Epoch]:
    """Train stage after stage; yields after each epoch.

    In a stage without `step` each node goes to the mean of all samples, weighted by the
    neighbourhood h (eq. 3) of their winners and their gain: the fixed points of eq. 2.

    u : (n, d), samples in the unit box
    residual : (n,), how wrong a smooth model is at each sample, for a gain
    """
    order = _by_place(u)
    u = u[order]
    lattice = stages[0].lattice
    full = stages[-1].lattice
    per_node = len(u) / full.size
    weights = rng.random((lattice.size, u.shape[1]))
    if len(stages) > 1:
        weights = spread_out(u, lattice)
    for stage in stages:
        if stage.lattice != lattice:
            weights = lattice.resample(weights, stage.lattice)
        lattice = stage.lattice
        rows = _rows_of_stage(len(u), lattice, full, rng)
        # a gain sees samples in the log's order
        log_order = np.argsort(order[rows])
        wrong = None if residual is None else residual[order[rows[log_order]]]
        samples = u[rows]
        for epoch in _epochs(
            stage, samples, weights, gain, log_order, wrong, per_node
        ):
            weights = epoch.weights
            yield epoch


def _epochs(
    stage: Stage,
    samples: Array,
    weights: Array,
    gain: Gain | None,
    log_order: Index,
    residual: Array | None,
    per_node: float,
) -> Iterator[Epoch]:
    """Train the nodes (nodes, d) of one stage by its samples (n, d); yields after each epoch.

    log_order : (n,), rows of the samples in the log's order, in which `residual` (n,) is
    per_node : samples of a node of the full lattice
    """
    lattice = stage.lattice
    ones = np.ones(len(samples))
    with_ones = np.column_stack([samples, ones])
    for sigma, progress in zip(stage.sigma.tolist(), stage.times, strict=True):
        tree = search_tree(weights)
        # where all samples show the topographic error, one search tells both
        ranks = 2 if shown_step(len(samples)) == 1 else 1
        distances, nodes = nearest_nodes(tree, samples, ranks)
        distance = distances[:, 0]
        winner = nodes[:, 0]  # eq. 1
        g = np.ones(len(samples))
        if gain is not None and progress is not None:
            visit = Visit(
                progress,
                winner[log_order],
                distance[log_order],
                weights,
                lattice,
                residual,
                sigma,
                per_node,
            )
            g[log_order] = gain(visit)  # eq. 7 and 8
        if ranks == 2:
            topographic = folded_share(nodes, lattice)
        else:
            topographic = topographic_error(samples, tree, lattice)
        weighted = g[:, None] * with_ones
        sums = group_sums(winner, weighted, lattice.size)
        weights = next_weights(weights, sums, lattice, sigma, stage.step)
        error = float(distance.mean())
        yield Epoch(weights, lattice, sigma, error, topographic)


def _rows_of_stage(
    n: int,
    lattice: Lattice,
    full: Lattice,
    rng: np.random.Generator,
) -> Index:
    """Ascending rows of the `n` samples that a stage shows: a coarse lattice sees some alone."""
    most = BATCH.samples_per_node * lattice.size
    if lattice == full or n <= most:
        return np.arange(n)
    rows = rng.choice(n, most, replace=False, shuffle=False)
    return np.sort(rows)


def _by_place(u: Array) -> Index:
    """An order in which close samples follow each other: their winners are found sooner."""
    dim = u.shape[1]
    per_axis = int(BATCH.sorting_cells ** (1 / dim))
    cell = np.zeros(len(u), dtype=np.uint16)
    for coordinate in u.T:
        step = np.clip(coordinate, 0.0, 0.999) * per_axis
        cell = cell * np.uint16(per_axis)
        cell = cell + step.astype(np.uint16)
    # in linear time, as they have 16 bits
    return np.argsort(cell, kind="stable")


def spread_out(u: Array, lattice: Lattice) -> Array:
    """Nodes (size, d) at even places of the unit box, or along the main axes of samples (n, d).

    A lattice with fewer axes than the space has lies in the plane in which the samples vary most.
    """
    sides = np.array(lattice.shape)
    place = (lattice.positions() + 0.5) / sides
    if lattice.dim >= u.shape[1]:
        return np.ascontiguousarray(place[:, : u.shape[1]])
    middle = u.mean(axis=0)
    _, _, main_axes = np.linalg.svd(u - middle, full_matrices=False)
    axes = main_axes[: lattice.dim]
    # of an even spread the half width is sqrt(3) standard deviations
    along_axes = (u - middle) @ axes.T
    deviation = np.std(along_axes, axis=0)
    half_width = np.sqrt(3.0) * deviation
    offsets = (2.0 * place - 1.0) * half_width
    return np.asarray(middle + offsets @ axes)


def neighbourhood_sums(
    sums: Array,
    lattice: Lattice,
    sigma: float,
) -> Array:
    """Sum over all nodes i of h_ji times the rows of `sums` (size, ...), one axis after another."""
    from scipy.ndimage import correlate1d

    grid = sums.reshape(*lattice.shape, -1)
    for axis, n in enumerate(lattice.shape):
        reach = min(int(REACH * sigma) + 1, n - 1)
        steps = np.arange(-reach, reach + 1)
        exponent = steps**2 / (-2.0 * sigma * sigma)
        h = np.exp(exponent)  # eq. 3
        grid = correlate1d(grid, h, axis, mode="constant")
    return grid.reshape(sums.shape)


def next_weights(
    weights: Array,
    sums: Array,
    lattice: Lattice,
    sigma: float,
    step: float | None,
) -> Array:
    """Weights (size, d) of the nodes after an epoch.

    Kohonen's batch rule puts each node at the mean of all samples, weighted by h of their winners.
    With a `step` nodes follow those of the winners instead, w_j += step sum_s h_ji (x_s - w_i) /
    sum_s h_ji, i the winner of s, which does not draw the border inwards.

    sums : (size, d + 1), sum of the samples that each node won, and their number or weight
    """
    if step is not None:
        counts = sums[:, -1:]
        steps = step * (sums[:, :-1] - counts * weights)
        sums = np.concatenate([steps, counts], axis=1)
    sums = neighbourhood_sums(sums, lattice, sigma)
    count = sums[:, -1:]
    active = count > 1e-12 * count.max()
    divisor = np.where(active, count, 1.0)
    mean = sums[:, :-1] / divisor
    if step is not None:
        mean = weights + mean
    return np.where(active, mean, weights)
