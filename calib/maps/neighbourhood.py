"""The neighbourhood of eq. 3 around one winner or on a whole lattice, and how nodes follow it."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .lattice import Lattice

REACH = 4.0
"""The neighbourhood is cut beyond so many sigma, where it is below exp(-8)."""


def around(lattice: Lattice, winner: int, *widths: float) -> tuple[tuple[slice, ...], Array]:
    """The nodes around a winner, and h at each of them (eq. 3).

    widths : sigma [nodes], or one for each axis
    """
    widths = widths * lattice.dim if len(widths) == 1 else widths
    reach = int(REACH * max(widths)) + 1
    window, h = [], np.ones(())
    places = np.unravel_index(winner, lattice.shape)
    for n, place, width in zip(lattice.shape, map(int, places), widths, strict=True):
        part = slice(max(0, place - reach), min(n, place + reach + 1))
        steps = np.arange(part.start - place, part.stop - place)
        h = np.multiply.outer(h, np.exp(steps**2 / (-2.0 * width * width)))
        window.append(part)
    return tuple(window), h


def spread(sums: Array, lattice: Lattice, sigma: float) -> Array:
    """Sum over all nodes i of h_ji times the rows of `sums` (eq. 3), (size, ...).

    A Gaussian along one lattice axis after the other.

    sums : (size, ...), a row per node
    lattice : where the nodes stand
    sigma : [nodes], neighbourhood radius
    """
    from scipy.ndimage import correlate1d

    grid = sums.reshape(*lattice.shape, -1)
    for axis, n in enumerate(lattice.shape):
        reach = min(int(REACH * sigma) + 1, n - 1)
        h = np.exp(np.arange(-reach, reach + 1) ** 2 / (-2.0 * sigma * sigma))
        grid = correlate1d(grid, h, axis, mode="constant")
    return np.asarray(grid.reshape(sums.shape))


def moved(weights: Array, sums: Array, lattice: Lattice, sigma: float, step: float | None) -> Array:
    """Where the nodes go after an epoch, (size, d).

    Kohonen's batch rule puts each node at the mean of all samples, weighted by the
    neighbourhood h of their winners: what eq. 2 comes to rest at.  With a `step` the
    nodes follow those of the winners instead,

        w_j += step sum_s h_ji (x_s - w_i) / sum_s h_ji,   i the winner of s,

    which does not draw the border inwards.  It rests where each node is the mean of the
    samples that it wins; a step of 2 or more would overshoot.

    weights : (size, d), the nodes
    sums : (size, d + 1), sum of the samples that each node won, and their number or weight
    sigma : [nodes], neighbourhood radius
    step : none for the batch rule
    """
    if step is not None:
        own = sums[:, -1:]
        sums = np.concatenate([step * (sums[:, :-1] - own * weights), own], axis=1)
    met = spread(sums, lattice, sigma)
    count = met[:, -1:]
    reached = count > 1e-12 * count.max()
    mean = met[:, :-1] / np.where(reached, count, 1.0)
    return np.where(reached, mean if step is None else weights + mean, weights)
