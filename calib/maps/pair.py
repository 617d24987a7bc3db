"""Two maps and their links from any paired samples: the paper's network as a building block.

``calib.SOM(...).fit_pair(q, x)``.  With the batch rule the links are those at which eq. 5
comes to rest.  With the online rule maps and links develop together: eq. 1 to 4 move the
nodes while eq. 5 is stepped sample by sample, and a curve tells how far they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.scale import Scale
from ..errors import OptionError
from .association import Association
from .density import Gain
from .epoch import Epoch
from .fields import Neighbourhood
from .lattice import Lattice
from .links import Wiring, oja, without_weak
from .map import Map, nearest_nodes, search_tree
from .online import Learner

CURVE = ("samples", "sigma", "zeta_motor", "zeta_sensory", "error")
"""Columns of a curve: samples shown, radius [nodes], distortions (eq. 9, unit box), and the
mean distance from new samples to what the readout ``activity`` says of them [unit]."""

_ETA = 0.13
"""Learning rate of the links (eq. 5)."""

_CHUNK = 250  # samples between two points of the curve
_LARGEST = 60_000_000  # links that are held densely


@dataclass(frozen=True, eq=False)
class Pair:
    """Two maps that were learned from the same samples.

    Attributes
    ----------
    association : Association
        The maps, their links and the readouts of these, in the unit boxes of both spaces.
    curve : (m, 5) array
        How they developed, columns as :data:`CURVE`; empty with the batch rule.
    """

    association: Association
    curve: Array

    def forward(self, q: Array, readout: str = "activity") -> Array:
        """What the links say of rows (n, d) of the first space, (n, k) in the second's unit."""
        pair = self.association
        u = pair.motor.scale.to_unit(np.atleast_2d(np.asarray(q, dtype=float)))
        return pair.sensory.scale.from_unit(pair.forward(u, readout))


def develop(
    q: Array,
    x: Array,
    lattice: Lattice,
    gain: Gain | None,
    sigma: tuple[float, float],
    epochs: int,
    wiring: Wiring,
    rng: np.random.Generator,
    neighbourhood: Neighbourhood | None = None,
    *,
    grown: bool = False,
) -> Pair:
    """Let two maps and their links develop together, one sample at a time (eq. 1 to 6).

    q, x : (n, d), (n, k), paired samples
    wiring : how nodes are active (eq. 6)
    The other parameters are those of :func:`calib.maps.online.learn_online`.
    """
    if lattice.size**2 > _LARGEST:
        raise OptionError(
            f"two maps of {lattice.size:,} nodes: eq. 5 keeps a Hebbian link for every pair of "
            f"nodes; give maps of at most {int(_LARGEST**0.5):,} nodes, or rule='batch'"
        )
    scales = (Scale.of_data(q), Scale.of_data(x))
    points = [scale.to_unit(rows) for scale, rows in zip(scales, (q, x), strict=True)]
    starts = [rng.random((lattice.size, p.shape[1])) for p in points]
    learners = [
        Learner(weights, lattice, gain, sigma, epochs * len(q), neighbourhood, grown)
        for weights in starts
    ]
    links: Any = np.zeros((lattice.size, lattice.size), dtype=np.float32)
    history: list[list[Epoch]] = [[], []]
    curve = []

    def maps() -> tuple[Map, Map]:
        motor, sensory = (
            Map(learner.weights, lattice, scale, np.array([e.row for e in told]).reshape(-1, 4))
            for learner, scale, told in zip(learners, scales, history, strict=True)
        )
        return motor, sensory

    with one_blas_thread():
        for _ in range(epochs):
            order = rng.permutation(len(q))
            zeta = np.zeros(2)
            for first in range(0, len(order), _CHUNK):
                rows = order[first : first + _CHUNK]
                error = _error(*maps(), links, wiring, points, rows, x)
                found = []
                for k, learner in enumerate(learners):
                    distance, _ = nearest_nodes(search_tree(learner.weights), points[k][rows])
                    found.append(float(np.mean(distance**2)))
                    zeta[k] += distance.sum()
                    learner.show(points[k][rows])
                curve.append((learner.done, learner.radius, *found, error))
                active = (
                    wiring.activity(net, p[rows]).toarray()
                    for net, p in zip(maps(), points, strict=True)
                )
                for a_motor, a_sensory in zip(*active, strict=True):
                    oja(links, a_motor, a_sensory, _ETA)  # eq. 5
            for told, learner, p, total in zip(history, learners, points, zeta, strict=True):
                error = float(total / len(q))
                told.append(Epoch.of(p, learner.weights, lattice, learner.radius, error))
        motor, sensory = maps()
        return Pair(Association(motor, sensory, without_weak(links), wiring), np.array(curve))


def _error(
    motor: Map,
    sensory: Map,
    links: Any,
    wiring: Wiring,
    points: list[Array],
    rows: NDArray[np.intp],
    x: Array,
) -> float:
    """Mean distance of samples to what the dense links say of them, before they are learned."""
    a = wiring.activity(motor, points[0][rows])
    strength = np.asarray(a @ links)
    total = strength.sum(axis=1, keepdims=True)
    if not (total > 0.0).any():
        return float("nan")
    predicted = sensory.scale.from_unit(strength @ sensory.units / np.maximum(total, 1e-30))
    return float(np.linalg.norm(predicted - x[rows], axis=1).mean())
