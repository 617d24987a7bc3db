"""Information: which further poses would be most informative about an arm.

A pose is worth as much as it shrinks the belief: half the logarithm of the predicted covariance of
its reading over that of the noise (D-optimal; maximum entropy sampling, Shewry and Wynn 1987).
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Index
from .belief import Body

# length [rad] over which the residual of a log is alike (Matern 5/2)
_SMOOTH = 0.5


def matern(q: Array, other: Array, lengths: Array) -> Array:
    """Matern 5/2 correlation (n, k) of joints (n, dof) and (k, dof)."""
    scaled = q / lengths
    others = other / lengths
    differences = scaled[:, None] - others
    distance = np.linalg.norm(differences, axis=2)
    d = np.sqrt(5.0) * distance
    rising = 1 + d + d * d / 3
    correlation: Array = rising * np.exp(-d)
    return correlation


def lengths_of(body: Body, q: Array) -> Array:
    """Correlation lengths (dof,) [rad or m] of the residual of a log with joints (n, dof)."""
    structure = body.structure
    span = np.ptp(q, axis=0)
    span = np.maximum(span, 1e-9)
    smooth = _SMOOTH * np.sqrt(structure.dof / 2)
    lengths: Array = np.where(structure.is_revolute, smooth, 0.3 * span)
    return lengths


def most_telling(body: Body, q: Array, n: int) -> Index:
    """Choose poses one by one, each the most informative after those chosen before.

    body : its posterior holds the measured rows already
    q : (k, dof) [rad or m], poses to choose from
    n : how many, at most k
    Returns (n,), rows of `q`, in the order of choice.
    """
    structure = body.structure
    p = structure.output_sizes[0]
    # what no parameter explains counts as noise
    noise = np.hypot(body.noise, body.tau)
    noise = noise[:p]
    _, slope = structure.linearise(q, body.beta, body.active)
    positions = slope[:, :p]
    directions = positions @ body.root
    directions *= body.kappa
    directions /= noise[:, None]
    return greedy(directions, n)


def greedy(directions: Array, n: int) -> Index:
    """Choose rows one by one, each of the largest gain of information after those before.

    directions : (k, p, r), derivatives of each row's reading by r independent unknowns of unit sd,
        in units of the noise: products of two rows' directions are their readings' covariance
    n : how many, at most k
    """
    chosen: list[int] = []
    for _ in range(n):
        gain = _gains(directions)
        gain[chosen] = -1.0
        best = int(gain.argmax())
        chosen.append(best)
        directions = after_reading(directions, directions[best])
    return np.array(chosen, dtype=np.intp)


def _gains(directions: Array) -> Array:
    """Gains (k,) of information [2 nats] of readings with directions (k, p, r)."""
    transposed = np.swapaxes(directions, 1, 2)
    covariance = directions @ transposed
    eye = np.eye(directions.shape[1])
    _, logarithms = np.linalg.slogdet(eye + covariance)
    gains: Array = logarithms
    return gains


def after_reading(directions: Array, reading: Array) -> Array:
    """Directions (..., r) after a reading of directions (p, r), whose unknowns it narrows."""
    axes, sizes, _ = np.linalg.svd(reading.T, full_matrices=False)
    # of sd one before, along each way
    sd = 1 / np.sqrt(1 + sizes**2)
    along_axes = directions @ axes
    explained = (1 - sd) * along_axes @ axes.T
    remaining: Array = directions - explained
    return remaining
