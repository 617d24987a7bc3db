"""Planar arm: joints, ranges, plane and kinematics of an arm that moves within one plane."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.wording import quoted, suggestion
from ..errors import OptionError, QueryError
from .chain import Chain, chunks
from .plane import Plane
from .ranges import TURN, Range, checked_range, one_turn

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlanarArm:
    """A planar arm: joints, limits, tip, plane and kinematics.

    Attributes
    ----------
    name : str
        The robot's name.
    joint_names : tuple of str
        Active joints, base to tip.
    lower, upper : (dof,) array [rad or m]
        Range of each joint that is babbled and learned.
    revolute : tuple of bool
        Whether each joint turns (rad) or slides (m).
    tip : str
        The link whose position is sensed.
    plane : Plane
        Where the tip moves, in the root link's frame.
    locked : dict of str to float [rad or m]
        The other movable joints between root and tip, and the values they are held at.
    urdf : str
        The URDF's own text.
    notes : tuple of str
        What was assumed or mended and should be said aloud.
    chain : Chain
        The folded transforms.
    limits : tuple of (float, float) [rad or m]
        What each joint can mechanically reach; `lower` and `upper` lie within.
    """

    name: str
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    revolute: tuple[bool, ...]
    tip: str
    plane: Plane
    locked: dict[str, float]
    urdf: str
    notes: tuple[str, ...]
    chain: Chain
    limits: tuple[Range, ...]

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("lower", "upper"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def dof(self) -> int:
        """Number of active joints."""
        return len(self.joint_names)

    @property
    def periodic(self) -> tuple[bool, ...]:
        """Whether each joint's range is a full turn, so that its ends meet."""
        widths = self.upper - self.lower
        return tuple(
            turns and bool(width >= TURN - 1e-9)
            for turns, width in zip(self.revolute, widths, strict=True)
        )

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

    def with_range(self, ranges: Mapping[str, Range]) -> PlanarArm:
        """Return the arm with only a part of some joints' ranges.

        Parameters
        ----------
        ranges : mapping of str to (lower, upper) [rad or m]
        """
        lower, upper, notes = self.lower.copy(), self.upper.copy(), list(self.notes)
        for name, chosen in ranges.items():
            k = self._index(name, "--range")
            unit = "rad" if self.revolute[k] else "m"
            lower[k], upper[k] = checked_range(name, chosen, self.limits[k], unit)
            if self.revolute[k]:
                (lower[k], upper[k]), note = one_turn(name, (lower[k], upper[k]))
                notes += [note] if note else []
        return replace(self, lower=lower, upper=upper, notes=tuple(notes))

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

    def _index(self, joint: str, what: str) -> int:
        if joint not in self.joint_names:
            raise OptionError(
                f"{what}: {quoted(joint)} is no active joint: {suggestion(joint, self.joint_names)}"
            )
        return self.joint_names.index(joint)

    def _rows(self, q: ArrayLike) -> tuple[Array, bool]:
        """Check joint values and return them as (n, dof), and whether they were one vector."""
        try:
            rows = np.asarray(q, dtype=float)
        except (TypeError, ValueError):
            raise QueryError(
                f"joint values must be numbers of shape (n, {self.dof}) [rad or m]"
            ) from None
        single = rows.ndim == 1
        rows = rows[None] if single else rows
        if rows.ndim != 2 or rows.shape[1] != self.dof:
            raise QueryError(
                f"joint values have shape {np.shape(q)}, expected (n, {self.dof}): "
                f"one column each for {', '.join(self.joint_names)}"
            )
        if not np.isfinite(rows).all():
            bad = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
            raise QueryError(f"joint values of row {bad} are not finite: {rows[bad]}")
        return rows, single
