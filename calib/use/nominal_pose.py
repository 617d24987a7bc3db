"""The nominal arm's pose: what a correction of six joints or more keeps besides the position."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import exponential, logarithm
from ..body.spatial import SpatialStructure
from ..inverse.pose import reach_poses

Array = NDArray[np.float64]

_STEPS = 4


@dataclass(frozen=True, eq=False)
class NominalPose:
    """Poses of the real and of the nominal arm, both in the root link's frame.

    Attributes
    ----------
    structure : SpatialStructure
        Seen by a sensor in the root link's frame.
    real, nominal : (d,) array
        Parameters.
    """

    structure: SpatialStructure
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
        found, _ = reach_poses(
            self._real, q, position, rotation, self.structure.chain.reach, _STEPS
        )
        return found

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
