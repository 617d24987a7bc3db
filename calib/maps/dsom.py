"""The dynamic self-organizing map (Rougier and Boniface, Neurocomputing 74, 2011).

Learning rate and neighbourhood follow the distance between a sample and its winner, not
time: a map that already represents a sample well is left alone, one that does not learns
at any age.  Elasticity takes the place of the radius.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from .lattice import Lattice
from .map import Epoch

_ELASTICITY = 3.0
"""How far a sample's pull reaches: 1 to 3 in the source."""

_RATE = 0.1
"""Learning rate epsilon of the source."""


def learn_dsom(
    u: Array, lattice: Lattice, epochs: int, rng: np.random.Generator
) -> Iterator[Epoch]:
    """Train a map that starts in the middle, see :func:`calib.maps.vdsom.passes`."""
    # from one place it unfolds; scattered nodes are close to every sample and stay put
    weights = 0.5 + 0.01 * (rng.random((lattice.size, u.shape[1])) - 0.5)
    for _ in range(epochs):
        error = float(np.mean(present_dsom(weights, lattice, u[rng.permutation(len(u))])))
        sigma = max(_widths(lattice, error, u.shape[1], _ELASTICITY))
        yield Epoch.of(u, weights, lattice, sigma, error)


def present_dsom(
    weights: Array,
    lattice: Lattice,
    samples: Array,
    elasticity: float = _ELASTICITY,
    rate: float = _RATE,
) -> list[float]:
    """Show samples to a map one after the other, in place; their distances to the winners.

    With d the distance to a node over the diagonal of the box, s the winner and p the
    nodes' places in a lattice of unit sides,

        w_i += rate d_i exp(-|p_i - p_s|^2 / (elasticity d_s)^2) (x - w_i).
    """
    dim = samples.shape[1]
    diagonal = float(np.sqrt(dim))
    grid = weights.reshape(*lattice.shape, -1)
    square = np.einsum("ij,ij->i", weights, weights)  # kept up to date below
    squares = square.reshape(lattice.shape)
    distances = []
    for x in samples:
        winner = int((square - 2.0 * (weights @ x)).argmin())
        gap = x - weights[winner]
        distance = float(np.sqrt(gap @ gap))
        distances.append(distance)
        if distance == 0.0:
            continue  # the source: h is zero where the winner stands on the sample
        window, h = lattice.around(winner, *_widths(lattice, distance, dim, elasticity))
        near = grid[window]
        away = x - near
        own = np.sqrt(np.einsum("...i,...i->...", away, away)) / diagonal
        near += (rate * h * own)[..., None] * away
        squares[window] = np.einsum("...i,...i->...", near, near)
    return distances


def _widths(lattice: Lattice, distance: float, dim: int, elasticity: float) -> tuple[float, ...]:
    """Sigma along each axis [nodes] at a distance to the winner, of a lattice of unit sides."""
    wide = elasticity * distance / math.sqrt(2.0 * dim)
    return tuple(wide * (n - 1) for n in lattice.shape)
