"""Loads: torques of gravity on the joints of a chain, which bend them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arm.spatial_chain import SpatialChain
from ..common.arrays import Array


@dataclass(frozen=True, eq=False)
class Loads:
    """Torques of gravity as shares of the largest that the first joint could carry."""

    chain: SpatialChain  # where nothing is known of its masses, there are no loads
    gravity: tuple[float, float, float]  # (3,) [m/s2], in the root frame

    @cached_property
    def torque(self) -> float:
        """Largest torque [N m] of the first joint: that of the arm stretched."""
        away = np.linalg.norm(self.chain.centres - self.chain.points[0], axis=1)
        return max(float(self.chain.masses @ away * np.linalg.norm(self.gravity)), 1e-12)

    def shares(self, q: Array) -> Array:
        """Loads (m, n) of the chain's joints at joint values (n, dof)."""
        # a fit asks for the same rows again, and they do not depend on its parameters
        last = self._memory.get("rows")
        if last is None or last[0] is not q:
            loads = self.chain.torques(q, np.asarray(self.gravity)).T / self.torque
            last = self._memory["rows"] = (q, np.ascontiguousarray(loads))
        return last[1]

    def slopes(self, q: Array) -> Array:
        """Derivatives (m, dof, n) of the loads by the joint values."""
        slopes = self.chain.torque_slopes(q, np.asarray(self.gravity)) / self.torque
        return np.moveaxis(slopes, 0, 2)

    @cached_property
    def _memory(self) -> dict[str, tuple[Array, Array]]:
        return {}
