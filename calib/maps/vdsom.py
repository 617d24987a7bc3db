"""The paper's algorithm, one sample at a time, in its own symbols: two maps and their links.

`VDSOM.show` is the algorithm, `Rates` has its schedules, `zeta` its distortion; the readings of
eq. 7 and 8 that are factors on a sample's update stand in `density.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.scale import Scale
from ..errors import OptionError
from .density import Gain, Visit, as_printed
from .lattice import Lattice
from .links import Wiring
from .map import Epoch, Map, nearest_nodes, search_tree
from .settings import ONLINE


@dataclass(frozen=True)
class Rates:
    """How fast some samples are learned; each array has a value for every sample."""

    sigma: tuple[Array, ...]  # neighbourhood radius of each map [nodes]
    alpha: Array  # learning rate of the maps
    progress: Array  # t / T
    eta: Array  # learning rate of the links
    beta: Array  # their forgetting factor

    @staticmethod
    def training(
        t: NDArray[np.intp], sigma: tuple[float, float], T: int, maps: int
    ) -> Rates:
        """Rates at the times `t` of a training of `T` samples, sigma from the first to the last."""
        fall = (sigma[1] / sigma[0]) ** (
            t / max(T - 1, 1)
        )  # exp(-t / T), T such that it ends so
        return Rates(
            (sigma[0] * fall,) * maps,  # eq. 4
            ONLINE.alpha * fall,  # eq. 4
            t / T,
            np.full(len(t), ONLINE.eta),
            np.ones(len(t)),
        )

    @staticmethod
    def following(
        t: NDArray[np.intp], start: Sequence[float], end: float, T: int
    ) -> Rates:
        """Rates `t` samples after a change, sigma of each map from its `start` [nodes]."""
        t = np.minimum(t, T)
        rise = np.exp(1.0 - t / T)
        return Rates(
            tuple(s * (end / s) ** (t / T) for s in start),  # eq. 10
            ONLINE.alpha * 0.1 ** (t / T),
            t / T,
            ONLINE.eta * rise,  # eq. 12
            1.0 * rise,  # eq. 12, beta_init = 1
        )


@dataclass
class Layer:
    """One map while it learns."""

    # w, (nodes, d), in the unit box; another array after each `VDSOM.show`
    weights: Array
    lattice: Lattice
    scale: Scale
    gain: Gain | None = None  # eq. 7 and 8, see `density.py`
    per_node: float = np.inf  # samples of the training per node

    @property
    def map(self) -> Map:
        """The map as it stands."""
        return Map(
            self.weights,
            self.lattice,
            self.scale,
            np.zeros((0, 4)),
        )

    def gains(self, x: Array, sigma: float, progress: float) -> Array:
        """Eq. 7 and 8 as a factor g on the update of each sample (n, d), for all at once."""
        if self.gain is None or self.gain is as_printed:
            return np.ones(len(x))
        distances, winners = nearest_nodes(search_tree(self.weights), x)
        visit = Visit(
            progress,
            winners[:, 0],
            distances[:, 0],
            self.weights,
            self.lattice,
            sigma=sigma,
            per_node=self.per_node,
        )
        return self.gain(visit)

    def active(
        self, w: Array, x: Array, widths: Array
    ) -> tuple[NDArray[np.intp], Array]:
        """The nodes that are active at a sample, and how much beside the most active (eq. 6)."""
        gap = w - x[:, None]
        if self.scale.periodic.any():
            gap = self.scale.difference(w.T, x).T
        exponent = (gap * gap).sum(axis=0) / widths
        least = exponent.min()
        j = np.flatnonzero(exponent < least + ONLINE.silent)
        return j, np.exp(least - exponent[j])  # eq. 6


class VDSOM:
    """Maps of varying density, and where there are two the links between them, while they learn.

    layers : one map, or the motor and the sensory one
    wiring : how nodes are active (eq. 6); without it there are no links
    links : (motor nodes, sensory nodes), c_ij to start from
    """

    def __init__(
        self,
        layers: Sequence[Layer],
        wiring: Wiring | None = None,
        links: Array | None = None,
    ) -> None:
        self.layers = tuple(layers)
        self.wiring = wiring
        # c_ij in single precision, row j, column i: the links of a sensory node lie together
        self._c: NDArray[np.float32] = np.zeros((0, 0), np.float32)
        if wiring is not None:
            self._c = _no_links(*(len(layer.weights) for layer in self.layers))
            if links is not None:
                self._c[:] = links.T

    def show(
        self, samples: Sequence[Array], rates: Rates, *, maps: bool = True
    ) -> list[Array]:
        """Learn from samples (n, d) of each map's space, in the unit boxes, in this order.

        maps : whether the maps learn, and not the links alone
        Returns the distance of each sample to its winner, (n,) for each map.
        """
        n = len(samples[0])
        distances = [np.empty(n) for _ in self.layers]
        for first in range(0, n, ONLINE.chunk):
            chunk = range(first, min(first + ONLINE.chunk, n))
            bandwidths = [
                self._squared_bandwidths(layer) for layer in self.layers
            ]
            last = chunk.stop - 1
            progress = float(rates.progress[last])
            spaces = zip(
                self.layers,
                samples,
                rates.sigma,
                strict=True,
            )
            gains = [
                layer.gains(x[first : last + 1], float(sigma[last]), progress)
                for layer, x, sigma in spaces
            ]
            weights = [
                np.ascontiguousarray(layer.weights.T) for layer in self.layers
            ]  # (d, nodes)
            for k in chunk:
                if maps:
                    for m, layer in enumerate(self.layers):
                        distances[m][k] = _learn_sample(
                            layer,
                            weights[m],
                            samples[m][k],
                            alpha=float(rates.alpha[k]),
                            sigma=float(rates.sigma[m][k]),
                            gain=float(gains[m][k - first]),
                            progress=float(rates.progress[k]),
                        )
                if self.wiring is not None:
                    self._learn_links(
                        weights, [x[k] for x in samples], bandwidths, rates, k
                    )
            for layer, w in zip(self.layers, weights, strict=True):
                layer.weights = np.ascontiguousarray(w.T)
        return distances

    def _learn_links(
        self,
        weights: Sequence[Array],
        sample: Sequence[Array],
        bandwidths: Sequence[Array],
        rates: Rates,
        k: int,
    ) -> None:
        """Let the links learn from sample `k`: d c_ij = eta (a_i a_j - beta a_j^2 c_ij) (eq. 5)."""
        motor, sensory = self.layers
        i, a_i = motor.active(weights[0], sample[0], bandwidths[0])
        j, a_j = sensory.active(weights[1], sample[1], bandwidths[1])
        eta = rates.eta[k]
        beta = rates.beta[k]
        self._c[j] *= (
            1.0 - eta * beta * a_j[:, None] ** 2
        )  # eq. 11 (eq. 5): forgetting
        self._c[j[:, None], i] += eta * np.outer(
            a_j, a_i
        )  # eq. 5: active together

    @property
    def links(self) -> NDArray[np.float32]:
        """c_ij as they stand, (motor nodes, sensory nodes)."""
        return self._c.T

    def said(self, u: Array, idle: Array | float = 0.0) -> Array:
        """Readout ``activity`` of the links for places (n, dof), (n, m), in the unit boxes.

        idle : (sensory nodes,), what each node should have forgotten besides, as an exponent
        """
        assert self.wiring is not None  # noqa: S101
        a = self.wiring.activity(self.layers[0].map, u)
        i = a.indices.reshape(len(u), -1)
        a_i = a.data.reshape(len(u), -1)
        strength = np.einsum("jnk,nk->nj", self._c[:, i], a_i) * np.exp(
            -np.asarray(idle)
        )
        total = np.maximum(strength.sum(axis=1, keepdims=True), 1e-30)
        return np.asarray(strength @ self.layers[1].weights / total)

    def _squared_bandwidths(self, layer: Layer) -> Array:
        """Squared bandwidth of each node's activity (eq. 6), in the unit box."""
        if self.wiring is None:
            return np.ones(1)
        network = layer.map
        spacing = (
            network.spacings
            if self.wiring.local
            else np.array([network.spacing])
        )
        return (self.wiring.bandwidth * spacing) ** 2


def _no_links(motor_nodes: int, sensory_nodes: int) -> NDArray[np.float32]:
    if motor_nodes * sensory_nodes > ONLINE.most_links:
        raise OptionError(
            f"maps of {motor_nodes:,} and {sensory_nodes:,} nodes: eq. 5 keeps a Hebbian link for "
            f"every pair of nodes; give maps of at most {int(ONLINE.most_links**0.5):,} nodes, or "
            "rule='batch' (adapt: method='few-shot')"
        )
    return np.zeros((sensory_nodes, motor_nodes), np.float32)


def _learn_sample(
    layer: Layer,
    w: Array,
    x: Array,
    *,
    alpha: float,
    sigma: float,
    gain: float,
    progress: float,
) -> float:
    """Let one map learn from a sample, in place; return its distance to the winner.

    w : (d, nodes), the weights
    x : (d,), the sample, in the unit box
    """
    squares = ((w - x[:, None]) ** 2).sum(axis=0)
    winner = int(squares.argmin())  # eq. 1
    grid = w.reshape(-1, *layer.lattice.shape)
    if layer.gain is as_printed:
        # no h_ji: nothing in eq. 8 falls with the distance from the winner, so that all nodes
        # follow each sample: 10x10 nodes of 2,000 samples of the unit square end within 0.02 of
        # each other, 0.3 from the samples
        to_neighbours = w[:, winner, None] - w[:, layer.lattice.beside(winner)]
        rho = np.exp(-np.sum(to_neighbours**2))  # eq. 7
        h = np.asarray(
            (progress / rho) ** 4 * np.exp(-progress / sigma**2)
        )  # eq. 8, printed
        step = np.minimum(alpha * h, 1.0)
    else:
        window, h = layer.lattice.around(winner, sigma)  # eq. 3
        grid = grid[(slice(None), *window)]
        # stable: eq. 8 weighs the sample (gain), and eq. 3 says how far it reaches; beyond 1 the
        # nodes around a winner would all jump to the sample
        step = min(alpha * gain, 1.0) * h  # eq. 8
    sample = x.reshape(-1, *(1,) * layer.lattice.dim)
    grid += step * (sample - grid)  # eq. 2
    return float(squares[winner] ** 0.5)


def zeta(weights: Array, x: Array) -> float:
    """Distortion of a map: mean squared distance of samples (n, d) to their winners (eq. 9)."""
    return float(
        np.mean(nearest_nodes(search_tree(weights), x)[0] ** 2)
    )  # eq. 9


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
    n = len(points[0])
    for epoch in range(epochs):
        order = rng.permutation(n)
        times = epoch * n + np.arange(n)
        rates = Rates.training(
            times,
            sigma,
            epochs * n,
            len(points),
        )
        distances = net.show([p[order] for p in points], rates)
        parts = zip(
            points,
            net.layers,
            rates.sigma,
            distances,
            strict=True,
        )
        yield [
            Epoch.of(
                p,
                layer.weights,
                layer.lattice,
                float(radii[-1]),
                float(distance.mean()),
            )
            for p, layer, radii, distance in parts
        ]
