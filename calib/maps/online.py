"""The online rule, as the paper writes it: one sample at a time (eq. 1 to 4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .density import Gain, Visit
from .epoch import Epoch
from .fields import Neighbourhood, Surroundings, checked_h, lattice_steps
from .lattice import Lattice
from .map import nearest_nodes, search_tree
from .neighbourhood import around
from .schedule import decay

_ALPHA = 0.5
"""Learning rate at the start (eq. 4)."""

_CHUNK = 512  # samples between two looks at the gain


@dataclass
class Learner:
    """A map that is shown samples while its radius and its learning rate fall (eq. 4)."""

    weights: Array  # (nodes, d), nodes in the unit box; another array after each `show`
    lattice: Lattice
    gain: Gain | None  # varying density; it is computed once per call of `show`
    sigma: tuple[float, float]  # [nodes], neighbourhood radius at the start and at the end
    steps: int  # samples that will be shown in all
    # in place of the Gaussian of eq. 3
    neighbourhood: Neighbourhood | None = None
    grown: bool = False  # whether `sigma` is the default, see :class:`~calib.maps.density.Visit`
    done: int = 0  # samples shown

    def __post_init__(self) -> None:
        self.radii = decay(*self.sigma, self.steps)

    @property
    def radius(self) -> float:
        """Neighbourhood radius of the latest sample [nodes]."""
        return float(self.radii[self.done - 1])

    def show(self, samples: Array) -> list[float]:
        """Learn from samples (n, d) in the unit box; the distance of each to its winner."""
        now = np.arange(self.done, self.done + len(samples))
        self.done += len(samples)
        rates = _ALPHA * self.radii[now] / self.sigma[0]  # eq. 4: one time constant for both
        if self.gain is not None:
            distance, winner = nearest_nodes(search_tree(self.weights), samples)
            t = self.done / self.steps
            visit = Visit(
                t, winner[:, 0], distance[:, 0], self.weights, self.lattice, grown=self.grown
            )
            # beyond 1 all nodes around a winner would jump to the sample: that tears the map
            rates = np.minimum(rates * self.gain(visit), 1.0)
        self.weights = self.weights.copy()
        return present_online(
            self.weights,
            self.lattice,
            samples,
            self.radii[now],
            rates,
            self.neighbourhood,
            now / self.steps,
        )


def learn_online(
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
    epochs : passes over the samples, each in another order
    rng : source of the start and of the orders
    The other parameters are those of :class:`Learner`.
    """
    weights = rng.random((lattice.size, u.shape[1]))
    steps = epochs * len(u)
    learner = Learner(weights, lattice, gain, sigma, steps, neighbourhood, grown)
    for _ in range(epochs):
        order = u[rng.permutation(len(u))]
        distances: list[float] = []
        for first in range(0, len(order), _CHUNK):
            distances += learner.show(order[first : first + _CHUNK])
        yield Epoch.of(u, learner.weights, lattice, learner.radius, float(np.mean(distances)))


def present_online(
    weights: Array,
    lattice: Lattice,
    samples: Array,
    sigma: Array,
    rate: Array,
    neighbourhood: Neighbourhood | None = None,
    progress: Array | None = None,
) -> list[float]:
    """Show samples to a map one after the other, in place (eq. 1 to 3).

    Exact, but for the Gaussian being cut where it falls below exp(-8).

    weights : (nodes, d), changed in place
    samples : (n, d), in the unit box
    sigma, rate : (n,), neighbourhood radius [nodes] and learning rate (times gain) of each sample.
        A node never moves beyond the sample: the step is min(1, rate h).
    neighbourhood : in place of the Gaussian of eq. 3, asked for the whole lattice.
    progress : (n,), t / T of each sample, which such a neighbourhood is told
    Returns list of float, distance of each sample to its winner.
    """
    axes = np.ascontiguousarray(weights.T)  # each coordinate in one piece: twice as fast
    grid, gap = axes.reshape(-1, *lattice.shape), np.empty_like(axes)
    apart = None if neighbourhood is None else lattice_steps(lattice)
    distances = []
    for k, (x, s, a) in enumerate(zip(samples, sigma.tolist(), rate.tolist(), strict=True)):
        np.subtract(axes, x[:, None], out=gap)
        square = np.multiply(gap, gap, out=gap).sum(axis=0)
        winner = int(square.argmin())  # eq. 1
        distances.append(float(np.sqrt(square[winner])))
        if neighbourhood is None or apart is None:
            window, h = around(lattice, winner, a, (s,) * lattice.dim)  # eq. 3
        else:
            place = np.unravel_index(winner, lattice.shape)
            # the part of all steps that begins at this winner
            here = tuple(
                slice(n - 1 - int(p), 2 * n - 1 - int(p))
                for n, p in zip(lattice.shape, place, strict=True)
            )
            t = 0.0 if progress is None else float(progress[k])
            window = (slice(None),) * lattice.dim
            h = a * checked_h(neighbourhood, Surroundings(apart[0][here], apart[1][here], s, t))
        near = grid[(slice(None), *window)]
        near += np.minimum(h, 1.0) * (x.reshape(-1, *(1,) * lattice.dim) - near)  # eq. 2
    weights[:] = axes.T
    return distances
