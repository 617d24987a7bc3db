"""Random starts: a coarse lattice that unfolds from noise, several times at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .epoch import Epoch, search, topographic_error
from .neighbourhood import moved, spread
from .schedule import Stage

Array = NDArray[np.float64]

STARTS = 8
"""Random starts, of which the one that unfolds best is kept."""


def unfold(u: Array, stages: list[Stage], rng: np.random.Generator) -> Iterator[Epoch]:
    """Order a coarse lattice from random starts; yields the epochs of the best one.

    A lattice can come to rest twisted, or with its corners where the data have none.  The
    energy of such a state is larger: the mean squared distance from a sample to the nodes
    around its winner, weighted by h of eq. 3 at a radius of one node.

    Parameters
    ----------
    u : (n, d) array
        Samples in the unit box.
    stages : list of Stage
        Stages on one lattice, so small that each sample is compared with all of its nodes.
    rng : numpy.random.Generator
        Source of the starts.
    """
    lattice = stages[0].lattice
    samples = np.column_stack([u, np.ones(len(u))])
    columns = np.repeat(samples.T, STARTS, axis=1)
    square = np.sum(u**2, axis=1, keepdims=True)
    weights = rng.random((lattice.size, STARTS, u.shape[1]))
    trace = []
    for stage in stages:
        for sigma in stage.sigma:
            score = _scores(samples, weights)
            winner = score.argmin(axis=2)  # eq. 1, (samples, starts)
            least = np.take_along_axis(score, winner[:, :, None], axis=2)[:, :, 0]
            error = np.sqrt(np.maximum(least + square, 0.0)).mean(axis=0)
            bins = (winner * STARTS + np.arange(STARTS)).ravel()
            won = [np.bincount(bins, c, lattice.size * STARTS) for c in columns]
            sums = np.stack(won, axis=1, dtype=float).reshape(lattice.size, STARTS, -1)
            weights = moved(weights, sums, lattice, float(sigma), stage.step)
            trace.append((weights, float(sigma), error))
    score = _scores(samples, weights)
    h = spread(np.eye(lattice.size), lattice, 1.0)
    h /= h.sum(axis=1, keepdims=True)
    energy = np.einsum("nsj,nsj->s", h[score.argmin(axis=2)], score)
    best = int(energy.argmin())
    for weights, sigma, error in trace:
        w = weights[:, best]
        topographic = topographic_error(u, search(w), lattice)
        yield Epoch(w, lattice, sigma, float(error[best]), topographic, len(u))


def _scores(samples: Array, weights: Array) -> Array:
    """Squared distance of each sample (x, 1) to each node, less |x|^2, (n, starts, nodes)."""
    nodes = weights.transpose(1, 0, 2)
    both = np.concatenate([-2.0 * nodes, np.sum(nodes**2, axis=2, keepdims=True)], axis=2)
    scores: Array = samples @ both.reshape(-1, samples.shape[1]).T
    return scores.reshape(len(samples), *nodes.shape[:2])
