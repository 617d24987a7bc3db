"""Two maps and their links from any paired samples: what ``calib.SOM.fit_pair`` returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from .association import Association
from .links import Wiring, without_weak
from .map import Map, nearest_nodes, search_tree
from .vdsom import VDSOM, Layer, Rates, passes

CURVE = ("samples", "sigma", "zeta_motor", "zeta_sensory", "error")
"""Columns of a curve: samples shown, radius [nodes], distortions (eq. 9, unit box), and the
mean distance from new samples to what the readout ``activity`` says of them [unit]."""

_GLANCE = 5  # one sample in so many tells the error


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

    def __repr__(self) -> str:
        return f"Pair({self.association!r}, curve of {len(self.curve)} points)"

    def forward(self, q: Array, readout: str = "activity") -> Array:
        """What the links say of rows (n, d) of the first space, (n, k) in the second's unit."""
        pair = self.association
        u = pair.motor.scale.to_unit(np.atleast_2d(np.asarray(q, dtype=float)))
        return pair.sensory.scale.from_unit(pair.forward(u, readout))


def develop(
    layers: Sequence[Layer],
    points: Sequence[Array],
    epochs: int,
    sigma: tuple[float, float],
    wiring: Wiring,
    rng: np.random.Generator,
    tell: Callable[[float, float], None] | None = None,
) -> Pair:
    """Let two maps and their links develop together, one sample at a time (eq. 1 to 8).

    layers : the motor and the sensory map as they start
    points : (n, d), (n, k), paired samples in the unit boxes
    tell : called with the share of the work done and the sensory quantization error
    The other parameters are those of :func:`calib.maps.vdsom.passes`.
    """
    net, curve, history = VDSOM(layers, wiring), [], []
    box = layers[1].scale

    def look(rows: NDArray[np.intp], done: int, rates: Rates) -> None:
        if done > len(rows):
            some = rows[::_GLANCE]
            gap = (net.said(points[0][some]) - points[1][some]) * box.span
            error = float(np.linalg.norm(gap, axis=1).mean())
        else:
            error = float("nan")  # there are no links yet
        found = [
            float(np.mean(nearest_nodes(search_tree(layer.weights), p[rows])[0] ** 2))  # eq. 9
            for layer, p in zip(net.layers, points, strict=True)
        ]
        curve.append((done, float(rates.sigma[1][-1]), *found, error))

    with one_blas_thread():
        for told in passes(net, points, epochs, sigma, rng, look):
            history.append(told)
            if tell is not None:
                tell(len(history) / epochs, told[1].error)
    motor, sensory = (
        Map(layer.weights, layer.lattice, layer.scale, np.array([e[k].row for e in history]))
        for k, layer in enumerate(net.layers)
    )
    return Pair(Association(motor, sensory, without_weak(net.links), wiring), np.array(curve))
