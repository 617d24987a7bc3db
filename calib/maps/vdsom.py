"""The paper's algorithm, one sample at a time: maps of varying density and the links between them.

For each sample x `VDSOM.show` does, in turn,

    i     = argmin_j |w_j - x|                      the winner of each map           (1)
    h_j   = exp(-|r_j - r_i|^2 / (2 sigma^2))       its neighbourhood                (3)
    w_j  += min(1, alpha g) h_j (x - w_j)           g: the gain of eq. 7 and 8       (2)
    a_j   = exp(-|w_j - x|^2 / width_j^2)           the activity of each map's nodes (6)
    c_ij += eta (a_i a_j - beta c_ij a_j^2)         i motor, j sensory               (5, 11)

`rates.py` has alpha, sigma, eta and beta (eq. 4, 10, 12), `density.py` has g, and `zeta` is eq. 9.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..common.scale import Scale
from ..errors import OptionError
from .density import Gain, Visit, as_printed
from .lattice import Lattice
from .links import Wiring
from .map import Epoch, Map, nearest_nodes, search_tree
from .rates import Rates
from .settings import ONLINE


class Layer:
    """One map while it learns.

    weights : (nodes, d), w at the start, in the unit box of the `scale`
    gain : eq. 7 and 8 as a factor on a sample's update; without it the map is a SOM
    per_node : samples of the training per node
    """

    def __init__(
        self,
        weights: Array,
        lattice: Lattice,
        scale: Scale,
        gain: Gain | None = None,
        per_node: float = np.inf,
    ) -> None:
        self.lattice = lattice
        self.scale = scale
        self.gain = gain
        self.per_node = per_node
        # (d, nodes): each operation runs along the nodes
        self._w = np.array(weights.T, order="C")

    @property
    def weights(self) -> Array:
        """Current weights w (nodes, d), in the unit box."""
        return np.array(self._w.T, order="C")

    @property
    def map(self) -> Map:
        """The map with its current weights."""
        no_history = np.zeros((0, 4))
        return Map(self.weights, self.lattice, self.scale, no_history)

    def learn(
        self,
        x: Array,
        alpha: float,
        sigma: float,
        gain: float,
        progress: float,
    ) -> float:
        """Learn from a sample (d,) in the unit box; return its distance to the winner."""
        gaps = self._w - x[:, None]
        squares = (gaps**2).sum(axis=0)
        winner = int(squares.argmin())  # eq. 1
        w = self._w.reshape(-1, *self.lattice.shape)
        if self.gain is as_printed:
            h_of_all = self._printed_h(winner, sigma, progress)
            step = np.asarray(min(alpha * h_of_all, 1.0))
        else:
            window, h = self.lattice.around(winner, sigma)  # eq. 3
            w = w[(slice(None), *window)]
            # beyond 1 the nodes around a winner would all jump to the sample
            step = min(alpha * gain, 1.0) * h  # eq. 8
        axes = (1,) * self.lattice.dim
        sample = x.reshape(-1, *axes)
        w += step * (sample - w)  # eq. 2
        return float(squares[winner] ** 0.5)

    def _printed_h(
        self,
        winner: int,
        sigma: float,
        progress: float,
    ) -> float:
        """Neighbourhood h of eq. 8 as printed, the same for all nodes.

        Nothing in it falls with the distance from the winner, so that all nodes follow each
        sample: 10x10 nodes of 2,000 samples of the unit square end within .02 of each other.
        """
        around = self._w[:, self.lattice.beside(winner)]
        gaps = self._w[:, winner, None] - around
        rho = np.exp(-np.sum(gaps**2))  # eq. 7
        growth = (progress / rho) ** 4
        return float(growth * np.exp(-progress / sigma**2))

    def gains(
        self,
        x: Array,
        sigma: float,
        progress: float,
    ) -> Array:
        """Eq. 7 and 8 as a factor g on the update of each sample (n, d), (n,)."""
        if self.gain is None or self.gain is as_printed:
            return np.ones(len(x))
        weights = self.weights
        distances, winners = nearest_nodes(search_tree(weights), x)
        visit = Visit(
            progress,
            winners[:, 0],
            distances[:, 0],
            weights,
            self.lattice,
            sigma=sigma,
            per_node=self.per_node,
        )
        return self.gain(visit)

    def activity(
        self,
        x: Array,
        squared_widths: Array,
    ) -> tuple[Index, Array]:
        """The active nodes at a sample (d,), and their activity relative to the most active one."""
        gap = self._w - x[:, None]
        if self.scale.periodic.any():
            gap = self.scale.difference(self._w.T, x).T
        exponent = (gap * gap).sum(axis=0) / squared_widths
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
        # c_ij, row j, column i: the links of a sensory node lie together
        self._c: NDArray[np.float32] = np.zeros((0, 0), np.float32)
        if wiring is not None:
            self._c = _no_links(*(layer.map.size for layer in self.layers))
            if links is not None:
                self._c[:] = links.T

    def show(
        self,
        samples: Sequence[Array],
        rates: Rates,
    ) -> list[Array]:
        """Learn from samples (n, d) of each map's space, in the unit boxes, in this order.

        Widths of eq. 6 and gains are those at the start of every 250 samples.
        Returns the distance of each sample to its winner, (n,) for each map.
        """
        n = len(samples[0])
        distances = [np.empty(n) for _ in self.layers]
        for first in range(0, n, ONLINE.chunk):
            chunk = range(first, min(first + ONLINE.chunk, n))
            squared_widths = self._squared_widths()
            gains = self._gains(samples, rates, chunk)
            for k in chunk:
                for m, layer in enumerate(self.layers):
                    distances[m][k] = layer.learn(
                        samples[m][k],
                        alpha=float(rates.alpha[k]),
                        sigma=float(rates.sigma[m][k]),
                        gain=float(gains[m][k - first]),
                        progress=float(rates.progress[k]),
                    )
                if self.wiring is not None:
                    motor, sensory = (
                        layer.activity(x[k], width)
                        for layer, x, width in zip(
                            self.layers, samples, squared_widths, strict=True
                        )
                    )
                    self._link(motor, sensory, rates.eta[k], rates.beta[k])
        return distances

    def _squared_widths(self) -> list[Array]:
        """Squared sigma of eq. 6 of each map's nodes, (nodes,); none without links."""
        if self.wiring is None:
            return []
        return [self.wiring.widths(layer.map) ** 2 for layer in self.layers]

    def _gains(
        self,
        samples: Sequence[Array],
        rates: Rates,
        chunk: range,
    ) -> list[Array]:
        """Factor g on the update of some of the samples, (chunk,) for each map."""
        last = chunk[-1]
        rows = slice(chunk[0], last + 1)
        progress = float(rates.progress[last])
        return [
            layer.gains(x[rows], float(sigma[last]), progress)
            for layer, x, sigma in zip(
                self.layers, samples, rates.sigma, strict=True
            )
        ]

    def _link(
        self,
        motor: tuple[Index, Array],
        sensory: tuple[Index, Array],
        eta: float,
        beta: float,
    ) -> None:
        """Link nodes i and j that are active together; what node j had before fades."""
        i, a_i = motor
        j, a_j = sensory
        fading = eta * beta * a_j[:, None] ** 2
        self._c[j] *= 1.0 - fading  # eq. 11
        self._c[j[:, None], i] += eta * np.outer(a_j, a_i)  # eq. 5

    @property
    def links(self) -> NDArray[np.float32]:
        """Current strengths c_ij (motor nodes, sensory nodes)."""
        return self._c.T

    def predict(self, u: Array) -> Array:
        """Readout ``activity`` of the links for joints (n, dof), (n, m), in the unit boxes."""
        assert self.wiring is not None  # noqa: S101
        motor, sensory = self.layers
        i, a_i = self.wiring.active_nodes(motor.map, u)
        strength = np.einsum("jnk,nk->nj", self._c[:, i], a_i)
        total = np.maximum(strength.sum(axis=1, keepdims=True), 1e-30)
        return np.asarray(strength @ sensory.weights / total)


def _no_links(motor_nodes: int, sensory_nodes: int) -> NDArray[np.float32]:
    """Links of zero between all nodes (sensory nodes, motor nodes), if memory holds them."""
    if motor_nodes * sensory_nodes > ONLINE.most_links:
        raise OptionError(
            f"maps of {motor_nodes:,} and {sensory_nodes:,} nodes: eq. 5 keeps a Hebbian link for "
            f"every pair of nodes; give maps of at most {int(ONLINE.most_links**0.5):,} nodes, or "
            "rule='batch' (adapt: method='few-shot')"
        )
    return np.zeros((sensory_nodes, motor_nodes), np.float32)


def zeta(weights: Array, x: Array) -> float:
    """Distortion of nodes (k, d): mean squared distance of samples (n, d) to their winners (eq. 9).

    As printed it also sums over all nodes, which measures how wide samples are, not how well they
    are represented.
    """
    distances, _ = nearest_nodes(search_tree(weights), x)
    return float(np.mean(distances**2))  # eq. 9


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
        t = epoch * n + np.arange(n)
        rates = Rates.training(t, sigma, epochs * n, len(points))
        samples = [x[order] for x in points]
        distances = net.show(samples, rates)
        yield [
            Epoch.of(
                x,
                layer.weights,
                layer.lattice,
                float(radius[-1]),
                float(distance.mean()),
            )
            for x, layer, radius, distance in zip(
                points, net.layers, rates.sigma, distances, strict=True
            )
        ]
