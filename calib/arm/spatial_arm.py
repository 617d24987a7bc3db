"""Spatial arm: an arm whose tip moves through space, its positions in the root link's frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import OptionError
from .arm import Arm


@dataclass(frozen=True, eq=False, kw_only=True)
class SpatialArm(Arm):
    """A spatial arm: joints, limits, tip and kinematics.

    Mimic joints on the way to the tip follow their leader; they are part of `chain` and not of
    `joint_names`.
    """

    @property
    def view(self) -> str:
        """What is measured: the tip's position in space."""
        return "space"

    @property
    def outputs(self) -> int:
        """Number of coordinates of a position."""
        return 3

    def with_tip_offset(self, dx: float, dy: float, dz: float = 0.0) -> SpatialArm:
        """Return the arm with its tip moved by dx, dy, dz [m] along the axes of its own frame."""
        offset = np.array([dx, dy, dz], dtype=float)
        if not np.isfinite(offset).all():
            raise OptionError(f"tip offset {dx}, {dy}, {dz}: expected three finite numbers [m]")
        tip = self.chain.tip + self.chain.rotation @ offset
        return replace(self, chain=replace(self.chain, tip=tip))
