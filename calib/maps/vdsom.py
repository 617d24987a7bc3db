"""The paper's algorithm, one sample at a time, in its own symbols: two maps and their links.

`VDSOM.show` is the algorithm, `Rates` has its schedules, `zeta` its distortion; the readings of
eq. 7 and 8 that are factors on a sample's update stand in `density.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.scale import Scale
from ..errors import OptionError
from .density import Gain, Visit, as_printed
from .lattice import Lattice
from .links import Wiring
from .map import Epoch, Map, nearest_nodes, search_tree

ALPHA = 0.5
"""Learning rate of the maps at the start, alpha_init of eq. 4."""

ETA = 0.13
"""Learning rate of the links (eq. 5), eta_init of eq. 12: eta beta stays below 1."""

CHUNK = 250
"""Samples between two looks at the nodes' spacings (eq. 6) and at a gain of the whole lattice."""

_SILENT = 7.0  # exponent of eq. 6 beyond which a node is silent: below 1e-3
_LARGEST = 100_000_000  # links that are held densely, 400 MB


@dataclass(frozen=True)
class Rates:
    """How fast some samples are learned; each array has a value for every sample."""

    sigma: tuple[Array, ...]  # neighbourhood radius of each map [nodes]
    alpha: Array  # learning rate of the maps
    progress: Array  # t / T
    eta: Array  # learning rate of the links
    beta: Array  # their forgetting factor

    @staticmethod
    def training(t: NDArray[Any], sigma: tuple[float, float], T: int, maps: int) -> Rates:
        """Rates at the times `t` of a training of `T` samples, sigma from the first to the last."""
        fall = (sigma[1] / sigma[0]) ** (t / max(T - 1, 1))  # exp(-t / T), T such that it ends so
        return Rates(
            (sigma[0] * fall,) * maps,  # eq. 4
            ALPHA * fall,  # eq. 4
            t / T,
            np.full(len(t), ETA),
            np.ones(len(t)),
        )

    @staticmethod
    def following(t: NDArray[Any], start: Sequence[float], end: float, T: int) -> Rates:
        """Rates `t` samples after a change, sigma of each map from its `start` [nodes]."""
        t = np.minimum(t, T)
        rise = np.exp(1.0 - t / T)
        return Rates(
            tuple(s * (end / s) ** (t / T) for s in start),  # eq. 10
            ALPHA * 0.1 ** (t / T),
            t / T,
            ETA * rise,  # eq. 12
            1.0 * rise,  # eq. 12, beta_init = 1
        )


@dataclass
class Layer:
    """One map while it learns."""

    weights: Array  # w, (nodes, d), in the unit box; another array after each `VDSOM.show`
    lattice: Lattice
    scale: Scale
    gain: Gain | None = None  # eq. 7 and 8, see `density.py`
    per_node: float = np.inf  # samples of the training per node

    @property
    def map(self) -> Map:
        """The map as it stands."""
        return Map(self.weights, self.lattice, self.scale, np.zeros((0, 4)))

    def gains(self, x: Array, sigma: float, progress: float) -> Array:
        """Eq. 7 and 8 as a factor g on the update of each sample (n, d), for all at once."""
        if self.gain is None or self.gain is as_printed:
            return np.ones(len(x))
        distance, winner = nearest_nodes(search_tree(self.weights), x)
        found = winner[:, 0], distance[:, 0], self.weights, self.lattice
        return self.gain(Visit(progress, *found, sigma=sigma, per_node=self.per_node))

    def active(self, w: Array, x: Array, widths: Array) -> tuple[NDArray[np.intp], Array]:
        """The nodes that are active at a sample, and how much beside the most active (eq. 6)."""
        gap = w - x[:, None]
        if self.scale.periodic.any():
            gap = self.scale.difference(w.T, x).T
        exponent = (gap * gap).sum(axis=0) / widths
        least = exponent.min()
        j = np.flatnonzero(exponent < least + _SILENT)
        return j, np.exp(least - exponent[j])  # eq. 6


class VDSOM:
    """Maps of varying density, and where there are two the links between them, while they learn.

    layers : one map, or the motor and the sensory one
    wiring : how nodes are active (eq. 6); without it there are no links
    links : (motor nodes, sensory nodes), c_ij to start from
    """

    def __init__(
        self, layers: Sequence[Layer], wiring: Wiring | None = None, links: Array | None = None
    ) -> None:
        self.layers, self.wiring = tuple(layers), wiring
        self._c: Any = None  # c_ij in single precision, row j, column i: a node's links together
        if wiring is not None:
            motor, sensory = (len(layer.weights) for layer in self.layers)
            if motor * sensory > _LARGEST:
                raise OptionError(
                    f"maps of {motor:,} and {sensory:,} nodes: eq. 5 keeps a Hebbian link for "
                    f"every pair of nodes; give maps of at most {int(_LARGEST**0.5):,} nodes, or "
                    "rule='batch' (adapt: method='few-shot')"
                )
            self._c = np.zeros((sensory, motor), np.float32)
            if links is not None:
                self._c[:] = links.T

    def show(self, samples: Sequence[Array], rates: Rates, *, maps: bool = True) -> list[Array]:
        """Learn from samples (n, d) of each map's space, in the unit boxes, in this order.

        maps : whether the maps learn, and not the links alone
        Returns the distance of each sample to its winner, (n,) for each map.
        """
        found = [np.empty(len(samples[0])) for _ in self.layers]
        for first in range(0, len(samples[0]), CHUNK):
            chunk = range(first, min(first + CHUNK, len(samples[0])))
            now, last = slice(first, chunk.stop), chunk.stop - 1
            grids, g = [], []
            widths = [self._widths(layer) for layer in self.layers]
            for layer, x, radii in zip(self.layers, samples, rates.sigma, strict=True):
                t = float(rates.progress[last])
                g.append(layer.gains(x[now], float(radii[last]), t))  # eq. 7
                grids.append(np.ascontiguousarray(layer.weights.T))  # of one coordinate each
            for k in chunk:
                t, alpha = float(rates.progress[k]), rates.alpha[k]  # t / T and eq. 4
                for m, layer in enumerate(self.layers if maps else ()):
                    w, x, sigma = grids[m], samples[m][k], float(rates.sigma[m][k])
                    square = ((w - x[:, None]) ** 2).sum(axis=0)
                    i = int(square.argmin())  # eq. 1
                    found[m][k] = square[i] ** 0.5
                    grid = w.reshape(-1, *layer.lattice.shape)
                    if layer.gain is as_printed:
                        # no h_ji: nothing in eq. 8 falls with the distance from the winner, so
                        # that all nodes follow each sample: 10x10 nodes of 2,000 samples of the
                        # unit square end within 0.02 of each other, 0.3 from the samples
                        local = w[:, i, None] - w[:, layer.lattice.beside(i)]
                        rho = np.exp(-np.sum(local**2))  # eq. 7
                        h = np.asarray((t / rho) ** 4 * np.exp(-t / sigma**2))  # eq. 8, printed
                        step = np.minimum(alpha * h, 1.0)
                    else:
                        near, h = layer.lattice.around(i, sigma)  # eq. 3
                        grid = grid[(slice(None), *near)]
                        # stable: eq. 8 weighs the sample (g), and eq. 3 says how far it reaches;
                        # beyond 1 the nodes around a winner would all jump to the sample
                        step = min(alpha * g[m][k - first], 1.0) * h  # eq. 8
                    grid += step * (x.reshape(-1, *(1,) * layer.lattice.dim) - grid)  # eq. 2
                if self.wiring is not None:
                    every = zip(self.layers, grids, samples, widths, strict=True)
                    (from_, a_i), (j, a_j) = (layer.active(w, x[k], b) for layer, w, x, b in every)
                    eta, beta = rates.eta[k], rates.beta[k]
                    # d c_ij = eta (a_i a_j - beta a_j^2 c_ij)
                    self._c[j] *= 1.0 - eta * beta * a_j[:, None] ** 2  # eq. 11 (eq. 5): forgetting
                    self._c[j[:, None], from_] += eta * np.outer(a_j, a_i)  # eq. 5: active together
            for layer, w in zip(self.layers, grids, strict=True):
                layer.weights = np.ascontiguousarray(w.T)
        return found

    @property
    def links(self) -> Any:
        """c_ij as they stand, (motor nodes, sensory nodes)."""
        return self._c.T

    def said(self, u: Array, idle: Array | float = 0.0) -> Array:
        """Readout ``activity`` of the links for places (n, dof), (n, m), in the unit boxes.

        idle : (sensory nodes,), what each node should have forgotten besides, as an exponent
        """
        assert self.wiring is not None  # noqa: S101
        a = self.wiring.activity(self.layers[0].map, u)
        i, a_i = a.indices.reshape(len(u), -1), a.data.reshape(len(u), -1)
        strength = np.einsum("jnk,nk->nj", self._c[:, i], a_i) * np.exp(-np.asarray(idle))
        total = np.maximum(strength.sum(axis=1, keepdims=True), 1e-30)
        return np.asarray(strength @ self.layers[1].weights / total)

    def _widths(self, layer: Layer) -> Array:
        """Squared bandwidth of each node's activity (eq. 6), in the unit box."""
        if self.wiring is None:
            return np.ones(1)
        network = layer.map
        spacing = network.spacings if self.wiring.local else np.array([network.spacing])
        return np.asarray((self.wiring.bandwidth * spacing) ** 2)


def zeta(weights: Array, x: Array) -> float:
    """Distortion of a map: mean squared distance of samples (n, d) to their winners (eq. 9)."""
    return float(np.mean(nearest_nodes(search_tree(weights), x)[0] ** 2))  # eq. 9


def passes(
    net: VDSOM,
    points: Sequence[Array],
    epochs: int,
    sigma: tuple[float, float],
    rng: np.random.Generator,
) -> Iterator[list[Epoch]]:
    """Show all samples `epochs` times, each time in another order; yields after each.

    points : (n, d) for each map, samples in the unit boxes
    sigma : neighbourhood radius at the start and at the end [nodes]
    """
    n, maps = len(points[0]), len(points)
    for epoch in range(epochs):
        order = rng.permutation(n)
        rates = Rates.training(epoch * n + np.arange(n), sigma, epochs * n, maps)
        found = net.show([p[order] for p in points], rates)
        yield [
            Epoch.of(p, layer.weights, layer.lattice, float(s[-1]), float(distance.mean()))
            for p, layer, s, distance in zip(points, net.layers, rates.sigma, found, strict=True)
        ]
