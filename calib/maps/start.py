"""Random starts: a coarse lattice that unfolds from noise, several times at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from .epoch import Epoch, topographic_error
from .lattice import Lattice
from .map import search_tree
from .neighbourhood import moved, spread
from .schedule import Stage

_RADIUS = 0.5  # of the energy by which a start is chosen [nodes]


def unfold(
    u: Array, judges: Array, stages: list[Stage], rng: np.random.Generator
) -> Iterator[Epoch]:
    """Order a coarse lattice from random starts; yields the epochs of the best one.

    A lattice can come to rest twisted, or with its corners where the data have none.  The
    energy of such a state is larger: the mean squared distance from a sample to the nodes
    around its winner, weighted by h of eq. 3.  At a radius of half a node, where it is
    largely the distortion, it tells best how accurate the map will be (tried from 0 to 2).

    u : (n, d), samples in the unit box, to learn from
    judges : (m, d), samples that choose, more of them: the starts differ by a few per cent
    stages : stages on one lattice, so small that each sample is compared with all of its nodes
    rng : source of the starts
    """
    lattice, starts = stages[0].lattice, stages[0].starts
    samples = np.column_stack([u, np.ones(len(u))])
    columns = np.repeat(samples.T, starts, axis=1)
    square = np.sum(u**2, axis=1, keepdims=True)
    weights = rng.random((lattice.size, starts, u.shape[1]))
    trace = []
    for stage in stages:
        for sigma in stage.sigma:
            score = _scores(samples, weights)
            winner = score.argmin(axis=2)  # eq. 1, (samples, starts)
            least = np.take_along_axis(score, winner[:, :, None], axis=2)[:, :, 0]
            error = np.sqrt(np.maximum(least + square, 0.0)).mean(axis=0)
            bins = (winner * starts + np.arange(starts)).ravel()
            won = [np.bincount(bins, c, lattice.size * starts) for c in columns]
            sums = np.stack(won, axis=1, dtype=float).reshape(lattice.size, starts, -1)
            weights = moved(weights, sums, lattice, float(sigma), stage.step)
            trace.append((weights, float(sigma), error))
    best = _best(judges, weights, lattice)
    for weights, sigma, error in trace:
        w = weights[:, best]
        topographic = topographic_error(u, search_tree(w), lattice)
        yield Epoch(w, lattice, sigma, float(error[best]), topographic, len(u))


def _best(u: Array, weights: Array, lattice: Lattice) -> int:
    """The start with the least energy, see `unfold`."""
    samples = np.column_stack([u, np.ones(len(u))])
    h = spread(np.eye(lattice.size), lattice, _RADIUS)
    h /= h.sum(axis=1, keepdims=True)
    energy = []
    for k in range(weights.shape[1]):
        score = _scores(samples, weights[:, k : k + 1])[:, 0]
        energy.append(np.vdot(h[score.argmin(axis=1)], score))
    return int(np.argmin(energy))


def _scores(samples: Array, weights: Array) -> Array:
    """Squared distance of each sample (x, 1) to each node, less |x|^2, (n, starts, nodes)."""
    nodes = weights.transpose(1, 0, 2)
    both = np.concatenate([-2.0 * nodes, np.sum(nodes**2, axis=2, keepdims=True)], axis=2)
    scores: Array = samples @ both.reshape(-1, samples.shape[1]).T
    return scores.reshape(len(samples), *nodes.shape[:2])
