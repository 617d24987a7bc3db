"""Trust: where a model answers, within the joints' range and where its bound means something."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..maps.map import Map
from ..maps.node_bounds import blend_nodes

Array = NDArray[np.float64]

MOST_SHARE = 0.1
"""Share of the reach: where the bound on the position exceeds it, there is no answer."""

KNOWN_SPACINGS, KNOWN_DISTANCES = 2.0, 3.0
"""Without a body the bound of a node holds within so many node spacings, or within so many
times the root mean square distance of its samples."""

ROUNDED = 1e-9
"""Share of a joint's range by which values beyond it count as rounded."""


@dataclass(frozen=True, eq=False)
class Trust:
    """Where answers are given.

    Attributes
    ----------
    motor : Map
        Motor map.
    bounds : (nodes,) array [unit]
        95 % bound on the position around each node.
    most : float [unit]
        Largest bound with which a position is still an answer.
    known : (nodes,) array, optional
        How far each node's own bound holds, in the unit box; the bound of a point further
        away grows.  Without it a bound holds wherever its node is the nearest, as that of a
        body does.
    growth : float [unit]
        What the position may change by over the unit box.
    """

    motor: Map
    bounds: Array
    most: float
    known: Array | None = None
    growth: float = 0.0

    def in_range(self, u: Array) -> NDArray[np.bool_]:
        """Which coordinates (n, dof) of the unit box are within the joints' range."""
        inside = (u >= -ROUNDED) & (u <= 1.0 + ROUNDED)
        return np.asarray(inside | self.motor.scale.periodic)

    def covers(self, u: Array) -> NDArray[np.bool_]:
        """Whether points of the unit box (n, dof) are answered, (n,)."""
        known = np.asarray(self.in_range(u).all(axis=1))
        if not self._everywhere and known.any():
            known[known] = self.bound(self.bounds, u[known]) <= self.most
        return known

    def bound(self, bounds: Array, u: Array) -> Array:
        """Bounds (n,) at points of the unit box (n, dof), from those of the nodes (nodes,)."""
        blended = blend_nodes(self.motor, bounds, u)
        if self.known is None:
            return blended
        distance, nearest = (part[:, 0] for part in self.motor.nearest(u))
        away = np.maximum(distance - self.known[nearest], 0.0)
        return np.asarray(blended + self.growth * away)

    @cached_property
    def _everywhere(self) -> bool:
        """Whether no bound is too large, wherever."""
        return self.known is None and bool((self.bounds <= self.most).all())
