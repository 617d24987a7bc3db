"""Blend: the nodes nearest to a point, and how much each of them counts there."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..common.arrays import Array
from .map import Map


def blend_size(dim: int) -> int:
    """Number of nodes whose local models are blended."""
    return {1: 3, 2: 4, 3: 6}.get(dim, 8)


class Blend:
    """The `m` nodes nearest to points `u` (n, d) of the unit box, the nearest first.

    A weight falls smoothly to zero where its node leaves the nearest `m`, so that what is blended
    has no steps.

    index, weight : (n, m), nodes, and their weights, which add up to 1
    """

    def __init__(self, motor: Map, u: Array, m: int | None = None) -> None:
        if m is None:
            m = blend_size(u.shape[1])
        m = min(m, motor.size - 1)
        distance, nodes = motor.nearest(u, m + 1)
        # its square is no zero
        self._last = np.maximum(distance[:, -1:], 1e-150)
        self._ratio = (distance[:, :-1] / self._last) ** 2
        # all at the same distance weigh the same
        raw = np.maximum((1.0 - self._ratio) ** 2, 1e-30)
        self._total = raw.sum(axis=1, keepdims=True)
        self._motor = motor
        self._u = u
        self._nodes = nodes
        self.index = nodes[:, :-1]
        self.weight = raw / self._total

    @property
    def gap(self) -> Array:
        """Offsets (n, m, d) of the points from the nodes."""
        return self._gaps[:, :-1]

    def mean(self, values: Array) -> Array:
        """Weighted means (n, ...) of values (n, m, ...) of the nodes."""
        means: Array = np.einsum("nm,nm...->n...", self.weight, values)
        return means

    def tilt(self) -> Array:
        """Derivatives (d, m, n) of the weights by the coordinates of the points, which are last."""
        ratio = self._ratio.T.copy()
        gaps = self._gaps.T.copy()
        # both distances of a ratio move with the point
        moved = gaps[:, :-1] - ratio * gaps[:, -1:]
        last_square = (self._last * self._last).T
        steepness = 4.0 * (ratio - 1.0)
        raw_slope = moved / last_square * steepness
        # the quotient rule for raw / total
        total_slope = raw_slope.sum(axis=1, keepdims=True)
        tilt = raw_slope - self.weight.T * total_slope
        return np.asarray(tilt / self._total.T)

    @cached_property
    def _gaps(self) -> Array:
        places = self._motor.units[self._nodes]
        return self._motor.scale.difference(self._u[:, None], places)


def blend_nodes(
    motor: Map,
    values: Array,
    u: Array,
) -> Array:
    """Values of the nodes (nodes,) blended at the points `u` (n, dof), (n,)."""
    blend = Blend(motor, u)
    return blend.mean(values[blend.index])
