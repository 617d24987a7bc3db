"""Kohonen's batch map, coarse to fine."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .density import Gain, Visit
from .epoch import Epoch, nearest, topographic_error
from .lattice import Lattice
from .schedule import Stage

Array = NDArray[np.float64]


def learn(
    u: Array,
    stages: list[Stage],
    gain: Gain | None,
    rng: np.random.Generator,
    partners: Array | None = None,
) -> Iterator[Epoch]:
    """Train stage after stage from a random start; yields after each epoch.

    Its fixed points are those of eq. 2: each node is the mean of all samples, weighted by
    the neighbourhood h (eq. 3) of their winners and, for a VDSOM, by their gain.
    """
    weights = rng.random((stages[0].lattice.size, u.shape[1]))
    lattice = stages[0].lattice
    for stage in stages:
        if stage.lattice != lattice:
            weights = lattice.resample(weights, stage.lattice)
        lattice = stage.lattice
        some = u if stage.samples >= len(u) else u[rng.permutation(len(u))[: stage.samples]]
        for epoch, sigma in enumerate(stage.sigma):
            topographic = topographic_error(some, weights, lattice)
            distance, winner = nearest(weights, some, 1)  # eq. 1
            g = None
            if gain is not None and stage.final:
                t = (epoch + 1) / len(stage.sigma)
                g = gain(Visit(t, winner, distance, weights, lattice, partners))
            sums = _smooth(_sums(some, winner, g, lattice.size), lattice, float(sigma))
            count = sums[:, -1:]
            reached = count > 1e-12 * count.max()
            weights = np.where(reached, sums[:, :-1] / np.where(reached, count, 1.0), weights)
            yield Epoch(
                weights, lattice, float(sigma), float(distance.mean()), topographic, len(some)
            )


def _sums(u: Array, winner: NDArray[np.intp], gain: Array | None, nodes: int) -> Array:
    """Sum of the samples and number of samples per node, (nodes, d + 1)."""
    columns = [c if gain is None else gain * c for c in u.T]
    columns.append(np.ones(len(u)) if gain is None else gain)
    return np.stack([np.bincount(winner, c, minlength=nodes) for c in columns], axis=1)


def _smooth(sums: Array, lattice: Lattice, sigma: float) -> Array:
    """Sums over the neighbourhood h_ji of eq. 3: a Gaussian along each lattice axis."""
    from scipy.ndimage import gaussian_filter1d

    grid = sums.reshape(*lattice.shape, -1)
    for axis in range(lattice.dim):
        grid = gaussian_filter1d(grid, sigma, axis=axis, mode="constant")
    return grid.reshape(lattice.size, -1)
