"""Dynamic map (DSOM): Rougier and Boniface, Neurocomputing 74, 2011."""

import math
from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
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
    weights = 0.5 + 0.01 * (rng.random((lattice.size, u.shape[1])) - 0.5)
    for _ in range(epochs):
        error = float(
            np.mean(present_dsom(weights, lattice, u[rng.permutation(len(u))]))
        )
        sigma = max(
            _widths(
                lattice,
                error,
                u.shape[1],
                DYNAMIC.elasticity,
            )
        )
        yield Epoch.of(
            u,
            weights,
            lattice,
            sigma,
            error,
        )


def present_dsom(
    weights: Array,
    lattice: Lattice,
    samples: Array,
    elasticity: float = DYNAMIC.elasticity,
    rate: float = DYNAMIC.rate,
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
        away = np.linalg.norm(weights - x, axis=1)
        winner = int(away.argmin())
        distance = float(away[winner])
        distances.append(distance)
        if distance == 0.0:
            continue  # the source: h is zero where the winner stands on the sample
        window, h = lattice.around(
            winner,
            *_widths(
                lattice,
                distance,
                dim,
                elasticity,
            ),
        )
        step = rate * h * away.reshape(lattice.shape)[window] / math.sqrt(dim)
        grid[window] += step[..., None] * (x - grid[window])
    return distances


def _widths(
    lattice: Lattice,
    distance: float,
    dim: int,
    elasticity: float,
) -> tuple[float, ...]:
    """Sigma along each axis [nodes] at a distance to the winner, of a lattice of unit sides."""
    wide = elasticity * distance / math.sqrt(2.0 * dim)
    return tuple(wide * (n - 1) for n in lattice.shape)
