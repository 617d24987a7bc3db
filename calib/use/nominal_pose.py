"""The nominal arm's pose: what a correction of six joints or more keeps besides the position."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import exponential, logarithm
from ..body.spatial import SpatialStructure
from ..body.spatial_row import SpatialRow
from ..inverse.one_row import to_pose
from ..inverse.pose import reach_poses

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NominalPose:
    """Poses of the real and of the nominal arm, both in the root link's frame."""

    structure: SpatialStructure  # seen by a sensor in the root link's frame
    # (d,), parameters
    real: Array
    nominal: Array

    @staticmethod
    def of(structure: SpatialStructure, real: Array, nominal: Array) -> NominalPose | None:
        """The poses of a body; None where there are too few joints to keep an orientation."""
        if structure.dof < 6:
            return None
        root = replace(structure, view="pose", metre=1.0, unit="m")
        still = [indices for name, indices in root.groups.items() if name.startswith("view.")]
        parts = []
        for beta in (real, nominal):
            own = beta.copy()
            own[np.concatenate(still)] = 0.0
            parts.append(own)
        return NominalPose(root, *parts)

    def towards(self, q: Array) -> Array:
        """Joints (n, dof) near `q` that give the real tool the nominal pose at `q`."""
        position, rotation = self.structure.pose(q, self.nominal)
        # of many steps: two or three suffice but beside singular poses
        return reach_poses(self._real, q, position, rotation, self.structure.chain.reach)[0]

    def one(self, q: list[float]) -> list[float] | None:
        """The same for one row of joints; None where `towards` has to answer."""
        real, nominal = self._rows
        return to_pose(real.twist, nominal.place(q), q)

    @cached_property
    def _rows(self) -> tuple[SpatialRow, SpatialRow]:
        return SpatialRow(self.structure, self.real), SpatialRow(self.structure, self.nominal)

    def angle(self, q: Array, corrected: Array) -> Array:
        """Angle (n,) [rad] between the nominal tool at `q` and the real one at other joints."""
        wanted = self.structure.pose(q, self.nominal)[1]
        turned = self.structure.pose(corrected, self.real)[1]
        known = np.isfinite(corrected).all(axis=1)
        out = np.full(len(q), np.nan)
        gap = turned[known] @ np.swapaxes(wanted[known], 1, 2)
        out[known] = np.linalg.norm(logarithm(gap), axis=1)
        return out

    def _real(self, q: Array) -> tuple[Array, Array, Array]:
        seen, slope = self.structure.predict_and_slope(q, self.real)
        return seen[:, :3], exponential(seen[:, 3:]), slope
