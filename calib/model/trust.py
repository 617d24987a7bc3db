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
    """

    motor: Map
    bounds: Array
    most: float

    def in_range(self, u: Array) -> NDArray[np.bool_]:
        """Which coordinates (n, dof) of the unit box are within the joints' range."""
        inside = (u >= -ROUNDED) & (u <= 1.0 + ROUNDED)
        return np.asarray(inside | self.motor.scale.periodic)

    def covers(self, u: Array) -> NDArray[np.bool_]:
        """Whether points of the unit box (n, dof) are answered, (n,)."""
        known = np.asarray(self.in_range(u).all(axis=1))
        if not self._everywhere and known.any():
            known[known] = blend_nodes(self.motor, self.bounds, u[known]) <= self.most
        return known

    @cached_property
    def _everywhere(self) -> bool:
        """Whether no bound is too large."""
        return bool((self.bounds <= self.most).all())
