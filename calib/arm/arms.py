"""Arms: planar, whose positions are x and y in their plane, or spatial, with x, y and z."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..errors import OptionError
from .arm import MIN_LENGTH, Arm
from .plane import Plane


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanarArm(Arm):
    """A planar arm: joints, limits, tip, plane and kinematics.

    Nothing is assumed planar but the positions: a joint that is not quite parallel to the
    others moves as it really does.

    Attributes
    ----------
    plane : Plane
        Where the tip moves, in the root link's frame.
    """

    outputs = 2
    plane: Plane

    def forward(self, q: ArrayLike) -> Array:
        """Positions in the plane (n, 2) or (2,) [m] at joint values (n, dof) or (dof,)."""
        return self._by_rows(q, lambda rows: self.plane.project(self.chain.positions(rows)))

    def jacobian(self, q: ArrayLike) -> Array:
        """Derivatives of the position by the joint values, (n, 2, dof) or (2, dof)."""
        axes = np.stack([self.plane.x, self.plane.y])
        return self._by_rows(q, lambda rows: axes @ self.chain.velocities(rows))

    def _links(self) -> Array:
        """Vectors within the plane, at zero (dof, 3) [m]."""
        links, normal = super()._links(), self.plane.normal
        return links - np.outer(links @ normal, normal)

    def with_tip_offset(self, dx: float, dy: float) -> PlanarArm:
        """Return the arm with its tip moved along (dx) and to the left of (dy) its last link.

        Where that link has no length in the plane, the plane's own axes at zero are used.
        """
        if not np.isfinite([dx, dy]).all():
            raise OptionError(f"tip offset {dx}, {dy}: expected two finite numbers [m]")
        along = self._links()[-1]
        length = float(np.linalg.norm(along))
        along = along / length if length >= MIN_LENGTH else self.plane.x
        left = np.cross(self.plane.normal, along)
        return replace(self, chain=replace(self.chain, tip=self.chain.tip + dx * along + dy * left))


@dataclass(frozen=True, eq=False, kw_only=True)
class SpatialArm(Arm):
    """A spatial arm: joints, limits, tip and kinematics.

    Mimic joints on the way to the tip follow their leader; they are part of `chain` and not of
    `joint_names`.
    """

    outputs = 3

    def with_tip_offset(self, dx: float, dy: float, dz: float = 0.0) -> SpatialArm:
        """Return the arm with its tip moved by dx, dy, dz [m] along the axes of its own frame."""
        offset = np.array([dx, dy, dz], dtype=float)
        if not np.isfinite(offset).all():
            raise OptionError(f"tip offset {dx}, {dy}, {dz}: expected three finite numbers [m]")
        tip = self.chain.tip + self.chain.rotation @ offset
        return replace(self, chain=replace(self.chain, tip=tip))
