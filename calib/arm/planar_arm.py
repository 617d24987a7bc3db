"""Planar arm: joints, ranges, plane and kinematics of an arm that moves within one plane."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import OptionError
from .arm import Arm
from .chain import Chain, chunks
from .plane import Plane
from .rotations import quaternion_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanarArm(Arm):
    """A planar arm: joints, limits, tip, plane and kinematics.

    Attributes
    ----------
    plane : Plane
        Where the tip moves, in the root link's frame.
    chain : Chain
        The folded transforms.
    rotation : (3, 3) array
        Orientation of the tip's frame where all joints are zero, in the root link's frame.
    """

    plane: Plane
    chain: Chain
    rotation: Array = field(default_factory=lambda: np.eye(3))

    @property
    def view(self) -> str:
        """What is measured: the tip's position within a plane."""
        return "plane"

    @property
    def outputs(self) -> int:
        """Number of coordinates of a position."""
        return 2

    @property
    def link_lengths(self) -> dict[str, float]:
        """In-plane distance [m] from each joint to the next, the last to the tip, at zero."""
        lengths = np.linalg.norm(self.chain.links(self.plane), axis=1)
        return dict(zip(self.joint_names, map(float, lengths), strict=True))

    def forward(self, q: ArrayLike) -> Array:
        """Return the tip's position in the plane.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]

        Returns
        -------
        (n, 2) or (2,) array [m]
        """
        rows, single = self._rows(q)
        out = np.empty((len(rows), 2))
        for part in chunks(len(rows)):
            out[part] = self.plane.project(self.chain.positions(rows[part]).T)
        return out[0] if single else out

    def jacobian(self, q: ArrayLike) -> Array:
        """Return the derivatives of the position by the joint values.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]

        Returns
        -------
        (n, 2, dof) or (2, dof) array [m/rad or m/m]
        """
        rows, single = self._rows(q)
        axes = np.stack([self.plane.x, self.plane.y])
        out = np.empty((len(rows), 2, self.dof))
        for part in chunks(len(rows)):
            out[part] = np.einsum("ij,jnk->nik", axes, self.chain.velocities(rows[part]))
        return out[0] if single else out

    def pose(self, q: ArrayLike) -> tuple[Array, Array]:
        """Return the tip's position and orientation in space.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]

        Returns
        -------
        positions : (n, 3) or (3,) array [m]
        quaternions : (n, 4) or (4,) array
            As qx, qy, qz, qw, in the root link's frame.
        """
        rows, single = self._rows(q)
        positions = self.chain.positions(rows).T
        quaternions = quaternion_of(self.chain.rotations(rows) @ self.rotation)
        return (positions[0], quaternions[0]) if single else (positions.copy(), quaternions)

    def points(self, q: ArrayLike) -> Array:
        """Return the joints' origins and the tip in space, to draw the arm.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]

        Returns
        -------
        (n, dof + 1, 3) or (dof + 1, 3) array [m]
            In the root link's frame.
        """
        rows, single = self._rows(q)
        out = self.chain.skeleton(rows)
        return out[0] if single else out

    def with_link_length(self, joint: str, length: float) -> PlanarArm:
        """Return the arm with the link that a joint carries at a new in-plane length [m]."""
        chain = self.chain.with_link_length(self._index(joint, "length"), length, self.plane)
        return replace(self, chain=chain)

    def with_tip_offset(self, dx: float, dy: float) -> PlanarArm:
        """Return the arm with its tip moved along (dx) and to the left of (dy) its last link."""
        offset = np.array([dx, dy], dtype=float)
        if not np.isfinite(offset).all():
            raise OptionError(f"tip offset {dx}, {dy}: expected two finite numbers [m]")
        return replace(self, chain=self.chain.with_tip_offset(offset, self.plane))
