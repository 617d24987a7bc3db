"""Dynamic map (DSOM): Rougier and Boniface, Neurocomputing 74, 2011."""

import math
from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from ..common.rows import row_lengths
from .lattice import Lattice
from .map import Epoch
from .settings import DYNAMIC


def learn_dsom(
    u: Array,
    lattice: Lattice,
    epochs: int,
    rng: np.random.Generator,
) -> Iterator[Epoch]:
    """Train a dynamic map, whose rate and radius follow the distance of a sample to its winner."""
    # from one place it unfolds; scattered nodes are close to every sample and stay put
    shape = lattice.size, u.shape[1]
    noise = rng.random(shape) - 0.5
    weights = 0.5 + 0.01 * noise
    for _ in range(epochs):
        samples = u[rng.permutation(len(u))]
        distances = present_dsom(weights, lattice, samples)
        error = float(np.mean(distances))
        widths = _widths(lattice, error, u.shape[1])
        yield Epoch.of(u, weights, lattice, max(widths), error)


def present_dsom(
    weights: Array, lattice: Lattice, samples: Array
) -> list[float]:
    """Show samples to a dynamic map one by one, in place; their distances to the winners.

    With d the distance to a node over the diagonal of the box, s the winner and p the
    nodes' places in a lattice of unit sides,

        w_i += rate d_i exp(-|p_i - p_s|^2 / (elasticity d_s)^2) (x - w_i).
    """
    dim = samples.shape[1]
    grid = weights.reshape(*lattice.shape, -1)
    distances: list[float] = []
    for x in samples:
        from_nodes = row_lengths(weights - x)
        winner = int(from_nodes.argmin())
        distance = float(from_nodes[winner])
        distances.append(distance)
        if distance == 0.0:
            continue  # the source: h is zero where the winner is at the sample
        widths = _widths(lattice, distance, dim)
        window, h = lattice.around(winner, *widths)
        in_window = from_nodes.reshape(lattice.shape)[window]
        step = DYNAMIC.rate * h * in_window / math.sqrt(dim)
        gap = x - grid[window]
        grid[window] += step[..., None] * gap
    return distances


def _widths(
    lattice: Lattice,
    distance: float,
    dim: int,
) -> tuple[float, ...]:
    """Sigma along each axis [nodes] at a distance to the winner, of a lattice of unit sides."""
    wide = DYNAMIC.elasticity * distance / math.sqrt(2.0 * dim)
    return tuple(wide * (n - 1) for n in lattice.shape)
