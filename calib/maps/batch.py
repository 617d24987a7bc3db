"""Kohonen's batch map, coarse to fine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .density import Gain, Visit
from .epoch import Epoch, nearest, topographic_error
from .lattice import Lattice
from .schedule import Stage

Array = NDArray[np.float64]

_STARTS = 5  # random starts of the coarsest lattice, of which the best unfolded is kept
_JUDGED = 2000  # samples by which that is judged


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
    lattice = stages[0].lattice
    if stages[0].final:
        weights = rng.random((lattice.size, u.shape[1]))
    else:
        starts = [_order(u, stages[0], rng) for _ in range(_STARTS)]
        first = min(starts, key=lambda start: start.energy)
        yield from first.epochs
        weights, stages = first.epochs[-1].weights, stages[1:]
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


@dataclass(frozen=True, eq=False)
class _Start:
    epochs: list[Epoch]
    energy: float


def _order(u: Array, stage: Stage, rng: np.random.Generator) -> _Start:
    """Order a coarse lattice from a random start, and tell how well it unfolded.

    A lattice can come to rest twisted, or with its corners where the data have none.  The
    energy of such a state is larger: the mean squared distance from a sample to the nodes
    around its winner, weighted by h of eq. 3 at a radius of one node.
    """
    epochs = list(learn(u, [replace(stage, final=True)], None, rng))
    weights, lattice = epochs[-1].weights, stage.lattice
    some = u[:: max(1, len(u) // _JUDGED)]
    apart = lattice.positions()[:, None] - lattice.positions()[None]
    h = np.exp(-np.sum(apart**2, axis=2) / 2.0)
    h /= h.sum(axis=1, keepdims=True)
    square = np.sum((some[:, None] - weights[None]) ** 2, axis=2)
    energy = float(np.einsum("nj,nj->", h[square.argmin(axis=1)], square)) / len(some)
    return _Start(epochs, energy)


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
