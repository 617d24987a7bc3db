"""Support: where samples were, so that a query far from all of them gets no answer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .map import Map, search_tree

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Array = NDArray[np.float64]

_REACH = 3.0  # a query may be so many node spacings from the nearest visited node
_CELLS = 100_000  # most cells of the grid


@dataclass(frozen=True, eq=False)
class Support:
    """The part of the joint space that was learned.

    Attributes
    ----------
    motor : Map
        Motor map.
    visited : (nodes,) bool array
        Nodes that samples have visited.
    """

    motor: Map
    visited: NDArray[np.bool_]

    def covers(self, u: Array) -> NDArray[np.bool_]:
        """Whether points of the unit box (n, dof) are within what was learned, (n,).

        That is at most one node spacing outside of the box, and near a visited node.
        """
        margin = self.motor.spacing
        inside = (u >= -margin) & (u <= 1.0 + margin)
        if self.motor.scale.periodic.any():
            inside |= self.motor.scale.periodic
        known: NDArray[np.bool_] = np.logical_and.reduce(inside, axis=1)
        if not self._everywhere and known.any():
            rows = np.flatnonzero(known)
            far = rows[~self._certain[self._cells(u[rows])]]
            if len(far):
                known[far] = self._near(u[far])
        return known

    @cached_property
    def _everywhere(self) -> bool:
        """Whether no point of the box is in doubt."""
        # a lattice of fewer dimensions than joints leaves gaps that tell nothing
        dof = self.motor.units.shape[1]
        return bool(self.visited.all()) or getattr(self.motor.lattice, "dim", dof) != dof

    @cached_property
    def _reach(self) -> float:
        # where samples are fewer than nodes the visited nodes stand further apart
        share = self.motor.size / max(1, int(np.count_nonzero(self.visited)))
        return float(_REACH * share ** (1 / self.motor.units.shape[1]) * self.motor.spacing)

    def _near(self, u: Array, margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether a visited node is within reach, or nearer by a margin, (n,)."""
        distance = np.asarray(self._tree.query(u)[0])
        near: NDArray[np.bool_] = distance + margin <= self._reach
        return near

    @cached_property
    def _tree(self) -> cKDTree:
        return search_tree(self.motor.units[self.visited], self.motor.scale)

    @cached_property
    def _side(self) -> int:
        """Cells of the grid along each axis: about one for each node spacing."""
        most = _CELLS ** (1 / self.motor.units.shape[1])
        return int(np.clip(1.0 / self.motor.spacing + 2.0, 1.0, most))

    @cached_property
    def _certain(self) -> NDArray[np.bool_]:
        """Cells all of whose points are near a visited node: most queries need no search."""
        dof, margin = self.motor.units.shape[1], self.motor.spacing
        width = (1.0 + 2.0 * margin) / self._side
        axis = (np.arange(self._side) + 0.5) * width - margin
        centers = np.stack(np.meshgrid(*[axis] * dof, indexing="ij"), axis=-1).reshape(-1, dof)
        # half a cell's diagonal, and a little for the rounding of its walls
        return self._near(centers, 0.5 * np.sqrt(dof) * width * (1.0 + 1e-9))

    def _cells(self, u: Array) -> NDArray[np.intp]:
        margin = self.motor.spacing
        scale = self._side / (1.0 + 2.0 * margin)
        cell = np.zeros(len(u), dtype=np.intp)
        for column in u.T:
            place = ((column + margin) * scale).astype(np.intp)
            cell = cell * self._side + np.clip(place, 0, self._side - 1)
        return cell
