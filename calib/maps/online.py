"""The online rule, as the paper writes it: one sample at a time (eq. 1 to 4).

Two functions show samples to a map.  :func:`present` is exact.  :func:`present_block`
shows a block of samples at once: while the radius is wide and the rate is high a block is
a single sample; later, when a sample moves few nodes by little, hundreds of them change
the map as if shown one after the other, but for

- their winners, which are those at the start of the block, and
- their order within the block, which is forgotten.

Both errors are of second order in the sum of alpha h that a node meets within a block,
which the length of the blocks keeps below 0.2 (times the gain of a VDSOM).  In both the
neighbourhood is cut where it falls below exp(-8).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .density import Gain, Visit
from .epoch import Epoch, nearest, topographic_error
from .fields import Neighbourhood, Surroundings, checked_h, lattice_steps
from .lattice import Lattice
from .map import search_tree
from .neighbourhood import REACH, spread
from .schedule import exponential

ALPHA = 0.5
"""Learning rate at the start (eq. 4)."""

_TOTAL = 0.2  # sum of alpha h that a node may meet within a block
_EXACT = 4  # blocks so short are shown sample by sample
_FEW = 96  # samples whose winners are found by comparing with every node
_CHUNK = 512  # samples between two looks at the gain, and in the longest block


def learn(
    u: Array,
    lattice: Lattice,
    gain: Gain | None,
    epochs: int,
    sigma: tuple[float, float],
    rng: np.random.Generator,
    neighbourhood: Neighbourhood | None = None,
    *,
    grown: bool = False,
) -> Iterator[Epoch]:
    """Train a map from a random start; yields after each pass over the samples.

    u : (n, d), samples in the unit box
    lattice : the lattice
    gain : varying density; it is computed once per 512 samples
    epochs : passes over the samples, each in another order
    sigma : [nodes], neighbourhood radius at the start and at the end; the learning rate falls with
        it
    rng : source of the start and of the orders
    neighbourhood : in place of the Gaussian of eq. 3; samples are then shown one by one.
    grown : whether `sigma` is the default, see :class:`~calib.maps.density.Visit`
    """
    start, end = sigma
    steps = epochs * len(u)
    radius = exponential(start, end, steps)
    alpha = ALPHA * radius / start  # eq. 4: one time constant for both
    weights = rng.random((lattice.size, u.shape[1]))
    done = 0
    for _ in range(epochs):
        order = u[rng.permutation(len(u))]
        total = 0.0
        for first in range(0, len(order), _CHUNK):
            chunk = order[first : first + _CHUNK]
            now = slice(done, done + len(chunk))
            done += len(chunk)
            rates, sigmas = alpha[now], radius[now]
            if gain is not None:
                distance, winner = winners(weights, chunk)
                visit = Visit(done / steps, winner, distance, weights, lattice, grown=grown)
                rates = rates * gain(visit)
            if neighbourhood is not None:
                t = np.arange(now.start, now.stop) / steps
                total += sum(present(weights, lattice, chunk, sigmas, rates, neighbourhood, t))
                continue
            length = block_length(lattice, float(sigmas[0]), float(alpha[now][0]))
            if length <= _EXACT:
                total += sum(present(weights, lattice, chunk, sigmas, rates))
                continue
            for k in range(0, len(chunk), length):
                part = slice(k, k + length)
                total += present_block(
                    weights, lattice, chunk[part], float(sigmas[part].mean()), rates[part]
                )
        yield Epoch(
            weights,
            lattice,
            float(radius[done - 1]),
            total / len(order),
            topographic_error(u, search_tree(weights), lattice),
            len(order),
        )


def block_length(lattice: Lattice, sigma: float, alpha: float) -> int:
    """Number of samples that hardly get into each other's way."""
    share = min(1.0, (2 * np.pi * sigma**2) ** (lattice.dim / 2) / lattice.size)
    return int(np.clip(_TOTAL / (alpha * share), 1, _CHUNK))


def winners(weights: Array, u: Array) -> tuple[Array, NDArray[np.intp]]:
    """Distance to and index of the best matching node of each sample (eq. 1)."""
    if len(u) > _FEW:
        return nearest(search_tree(weights), u)
    scores = u @ weights.T
    scores *= -2.0
    scores += np.einsum("ij,ij->i", weights, weights)
    index = scores.argmin(axis=1)
    return np.linalg.norm(weights[index] - u, axis=1), index


def present(
    weights: Array,
    lattice: Lattice,
    samples: Array,
    sigma: Array,
    rate: Array,
    neighbourhood: Neighbourhood | None = None,
    progress: Array | None = None,
) -> list[float]:
    """Show samples to a map one after the other, in place (eq. 1 to 3).

    weights : (nodes, d), changed in place
    samples : (n, d), in the unit box
    sigma, rate : (n,), neighbourhood radius [nodes] and learning rate (times gain) of each sample.
        A node never moves beyond the sample: the step is min(1, rate h).
    neighbourhood : in place of the Gaussian of eq. 3, asked for the whole lattice.
    progress : (n,), t / T of each sample, which such a neighbourhood is told
    Returns list of float, distance of each sample to its winner.
    """
    grid = weights.reshape(*lattice.shape, -1)
    axes = [np.arange(n, dtype=float) for n in lattice.shape]
    apart = None if neighbourhood is None else lattice_steps(lattice)
    distances = []
    for k, (x, s, a) in enumerate(zip(samples, sigma, rate, strict=True)):
        gap = weights - x
        square = np.einsum("ij,ij->i", gap, gap)
        winner = int(square.argmin())  # eq. 1
        distances.append(float(np.sqrt(square[winner])))
        place = np.unravel_index(winner, lattice.shape)
        if neighbourhood is not None and apart is not None:
            # the part of all steps that begins at this winner
            here = tuple(
                slice(n - 1 - int(p), 2 * n - 1 - int(p))
                for n, p in zip(lattice.shape, place, strict=True)
            )
            t = 0.0 if progress is None else float(progress[k])
            around = Surroundings(apart[0][here], apart[1][here], float(s), t)
            window: tuple[slice, ...] = (slice(None),) * lattice.dim
            h = a * checked_h(neighbourhood, around)
        else:
            reach = int(REACH * s) + 1
            window = tuple(slice(max(0, int(p) - reach), int(p) + reach + 1) for p in place)
            h = np.array(a)
            for axis, p, part in zip(axes, place, window, strict=True):  # eq. 3, axis by axis
                h = np.multiply.outer(h, np.exp((axis[part] - p) ** 2 / (-2.0 * s * s)))
        near = grid[window]
        near += np.minimum(h, 1.0)[..., None] * (x - near)  # eq. 2
    return distances


def present_block(
    weights: Array, lattice: Lattice, samples: Array, sigma: float, rate: Array
) -> float:
    """Show samples to a map at once, in place; see the module for what is exact.

    A node that meets the rates r_s = alpha_s h_s keeps exp(-sum r) of its place and moves
    towards the mean of the samples, weighted by r: what many small steps of eq. 2 add up
    to.  It never moves beyond them.  The radius is one for all samples; the result is the sum of
    their distances to their winners.
    """
    distance, winner = winners(weights, samples)
    if lattice.dim == 2 and 2 * REACH * sigma + 3 > min(lattice.shape) / 2:
        met = _spread_wide(lattice, samples, sigma, rate, winner)
    else:
        met = _spread_near(lattice, samples, sigma, rate, winner)
    total = met[:, -1:]
    moved = np.flatnonzero(total[:, 0] > 0.0)
    total = total[moved]
    mean = met[moved, :-1] / total
    weights[moved] += -np.expm1(-total) * (mean - weights[moved])
    return float(distance.sum())


def _spread_wide(
    lattice: Lattice, samples: Array, sigma: float, rate: Array, winner: NDArray[np.intp]
) -> Array:
    """Sums over the samples of r x and r at every node, (nodes, d + 1): h is a product."""
    rows, columns = np.unravel_index(winner, lattice.shape)
    first, second = (
        np.exp((np.arange(n) - place[:, None]) ** 2 / (-2.0 * sigma * sigma))
        for n, place in zip(lattice.shape, (rows, columns), strict=True)
    )
    values = np.column_stack([samples, np.ones(len(samples))])
    right = (second[:, :, None] * values[:, None, :]).reshape(len(samples), -1)
    return np.asarray(((first * rate[:, None]).T @ right).reshape(lattice.size, -1))


def _spread_near(
    lattice: Lattice, samples: Array, sigma: float, rate: Array, winner: NDArray[np.intp]
) -> Array:
    """The same, where the neighbourhood is narrow: summed per winner, then smoothed."""
    n = lattice.size
    columns = [np.bincount(winner, rate * c, n) for c in samples.T]
    columns.append(np.bincount(winner, rate, n))
    return spread(np.stack(columns, axis=1), lattice, sigma)
