"""Spatial arm: an arm whose tip moves through space, its kinematics checked by Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OptionError
from .arm import Arm, Array
from .chain import chunks
from .rotations import quaternion_of
from .spatial_chain import SpatialChain


@dataclass(frozen=True, eq=False, kw_only=True)
class SpatialArm(Arm):
    """A spatial arm: joints, limits, tip and kinematics.

    Positions are in the root link's frame. Mimic joints on the way to the tip follow their
    leader; they are part of `chain` and not of `joint_names`.

    Attributes
    ----------
    chain : SpatialChain
        The folded transforms.
    """

    chain: SpatialChain

    @property
    def view(self) -> str:
        """What is measured: the tip's position in space."""
        return "space"

    @property
    def outputs(self) -> int:
        """Number of coordinates of a position."""
        return 3

    @property
    def link_lengths(self) -> dict[str, float]:
        """Distance [m] from each active joint to the next, the last to the tip, at zero."""
        stops = np.vstack([self.chain.points[self._own], self.chain.tip])
        lengths = np.linalg.norm(np.diff(stops, axis=0), axis=1)
        return dict(zip(self.joint_names, map(float, lengths), strict=True))

    def forward(self, q: ArrayLike) -> Array:
        """Return the tip's position.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]

        Returns
        -------
        (n, 3) or (3,) array [m]
        """
        rows, single = self._rows(q)
        out = np.empty((len(rows), 3))
        for part in chunks(len(rows)):
            out[part] = self.chain.positions(rows[part])
        return out[0] if single else out

    def pose(self, q: ArrayLike) -> tuple[Array, Array]:
        """Return the tip's position and orientation.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]

        Returns
        -------
        positions : (n, 3) or (3,) array [m]
        quaternions : (n, 4) or (4,) array
            As qx, qy, qz, qw.
        """
        rows, single = self._rows(q)
        positions, quaternions = np.empty((len(rows), 3)), np.empty((len(rows), 4))
        for part in chunks(len(rows)):
            positions[part], matrices = self.chain.poses(rows[part])
            quaternions[part] = quaternion_of(matrices)
        return (positions[0], quaternions[0]) if single else (positions, quaternions)

    def jacobian(self, q: ArrayLike) -> Array:
        """Return the geometric Jacobian in the root frame.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]

        Returns
        -------
        (n, 6, dof) or (6, dof) array
            Rows 0 to 2 differentiate the position [m/rad or m/m], rows 3 to 5 give the angular
            velocity of the tip's frame.
        """
        rows, single = self._rows(q)
        out = np.empty((len(rows), 6, self.dof))
        for part in chunks(len(rows)):
            out[part] = self.chain.jacobian(rows[part])
        return out[0] if single else out

    def points(self, q: ArrayLike) -> Array:
        """Return the joints' origins and the tip, to draw the arm.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]

        Returns
        -------
        (n, m + 1, 3) or (m + 1, 3) array [m]
            m joints, mimic joints included.
        """
        rows, single = self._rows(q)
        out = self.chain.skeleton(rows)
        return out[0] if single else out

    def with_link_length(self, joint: str, length: float) -> SpatialArm:
        """Return the arm with the link from a joint to the next (or the tip) at a new length [m].

        The link is stretched along itself; all that lies beyond is carried along.
        """
        k = self._index(joint, "length")
        if not np.isfinite(length) or length < 0:
            raise OptionError(f"link length {length:g} m: expected a finite number, 0 or more")
        own = self._own
        start = self.chain.points[own[k]]
        end = self.chain.points[own[k + 1]] if k + 1 < self.dof else self.chain.tip
        old = float(np.linalg.norm(end - start))
        if old < 1e-9:
            raise OptionError(
                f"the link of joint {joint!r} has no length: nothing can be stretched; change "
                "another joint's link"
            )
        shift = (length / old - 1.0) * (end - start)
        points, centres = self.chain.points.copy(), self.chain.centres.copy()
        first = own[k + 1] if k + 1 < self.dof else self.chain.joints
        points[first:] += shift
        centres[first:] += shift
        chain = replace(self.chain, points=points, centres=centres, tip=self.chain.tip + shift)
        return replace(self, chain=chain)

    def with_tip_offset(self, dx: float, dy: float, dz: float = 0.0) -> SpatialArm:
        """Return the arm with its tip moved by dx, dy, dz [m] along the axes of its own frame."""
        offset = np.array([dx, dy, dz], dtype=float)
        if not np.isfinite(offset).all():
            raise OptionError(f"tip offset {dx}, {dy}, {dz}: expected three finite numbers [m]")
        tip = self.chain.tip + self.chain.rotation @ offset
        return replace(self, chain=replace(self.chain, tip=tip))

    @property
    def _own(self) -> list[int]:
        """Chain joints that are the active ones themselves, not their followers."""
        own: list[int] = []
        for k in range(self.dof):
            unit = np.eye(self.dof)[k]
            same = (self.chain.coupling == unit).all(axis=1) & (self.chain.bias == 0)
            own.append(int(np.flatnonzero(same)[0]))
        return own
