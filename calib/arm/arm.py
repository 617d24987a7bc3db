"""Arm: joints, ranges and kinematics of a folded chain, planar (x, y) or spatial (x, y, z)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Range, freeze_copies
from ..common.inputs import query_rows
from ..common.rows import row_lengths
from ..common.scale import TURN
from ..common.wording import by_name, listing, quoted, suggestion
from ..errors import OptionError
from .gravity import GRAVITY
from .plane import Plane
from .rotations import quaternion_of
from .spatial_chain import SpatialChain

_A = TypeVar("_A", bound="Arm")

_MIN_LENGTH = 1e-9
"""A link shorter than this [m] has no direction in which it could be lengthened."""

_CACHED = 2_048
"""Rows whose intermediate arrays stay in the processor's cache."""

_ROUNDING = 1e-3
"""An excess [rad or m] over one turn or a limit (3.1416, 1.5708) that is clipped in silence."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Arm:
    """A serial arm: names, ranges and the URDF that they come from.

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
    locked : dict of str to float [rad or m]
        The other movable joints between root and tip, and the values they are held at.
    urdf : str
        The text of the URDF or MJCF.
    notes : tuple of str
        What was assumed or mended, for the user.
    limits : tuple of (float, float) [rad or m]
        What each joint can mechanically reach; `lower` and `upper` lie within.
    travel : tuple of (float, float) [rad or m]
        The joints' permitted range: where that is more than a turn, `lower` to `upper` is one
        turn of it.
    gravity : (3,) array [m/s2]
        Gravity in the root link's frame.
    chain : SpatialChain
        The folded transforms, mimic joints included, in the root link's frame.
    """

    # number of coordinates of a position: 2 in a plane, 3 in space
    outputs: ClassVar[int]
    name: str
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    revolute: tuple[bool, ...]
    tip: str
    locked: dict[str, float]
    urdf: str
    notes: tuple[str, ...]
    limits: tuple[Range, ...]
    travel: tuple[Range, ...]
    chain: SpatialChain
    gravity: tuple[float, float, float] = GRAVITY

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        freeze_copies(self, "lower", "upper")

    def forward(self, q: ArrayLike) -> Array:
        """Positions (n, outputs) or (outputs,) [m] at joint values (n, dof) or (dof,)."""
        return self._by_rows(q, lambda rows: self.chain.poses(rows)[0])

    def jacobian(self, q: ArrayLike) -> Array:
        """Derivatives (n, k, dof) or (k, dof) of the position by joint values (n, dof) or (dof,).

        In [m/rad or m/m]; of a spatial arm k is 6: rows 3 to 5 are the angular velocity of the
        tip's frame.
        """
        return self._by_rows(q, self.chain.jacobian)

    def pose(self, q: ArrayLike) -> tuple[Array, Array]:
        """Return the tip's positions (n, 3) or (3,) [m] and quaternions (n, 4) or (4,) in space.

        At joint values (n, dof) or (dof,) [rad or m]; as qx, qy, qz, qw, in the root link's frame.
        """

        def poses(rows: Array) -> Array:
            positions, matrices = self.chain.poses(rows)
            return np.hstack([positions, quaternion_of(matrices)])

        pose = self._by_rows(q, poses)
        return pose[..., :3], pose[..., 3:]

    def __repr__(self) -> str:
        """Name the arm in a line: its name, its joints, its tip."""
        joints = ", ".join(self.joint_names)
        return f"{type(self).__name__} {self.name}: {joints}; tip {self.tip}"

    @property
    def link_lengths(self) -> dict[str, float]:
        """Distance [m] from each joint to the next, the last to the tip, at zero."""
        lengths = row_lengths(self._links())
        return by_name(self.joint_names, map(float, lengths))

    def with_link_length(self: _A, joint: str, length: float) -> _A:
        """Return the arm with the link from a joint to the next (or the tip) at a new length [m].

        The link is stretched along itself; all that lies beyond is carried along.
        """
        k = self._joint_number(joint, "length")
        link = self._links()[k]
        chain = self.chain
        places = self._active_places
        old = float(np.linalg.norm(link))
        if old < _MIN_LENGTH or not 0.0 <= length < math.inf:
            raise OptionError(
                f"length {length:g} m of the link of joint {quoted(joint)}, which is {old:g} m "
                "long: expected 0 or more, of a link that has a length"
            )
        shift = (length / old - 1.0) * link
        points = chain.points.copy()
        centres = chain.centres.copy()
        beyond = places[k + 1] if k + 1 < self.dof else chain.joints
        points[beyond:] += shift
        centres[beyond:] += shift
        chain = replace(
            chain, points=points, centres=centres, tip=chain.tip + shift
        )
        return replace(self, chain=chain)

    def with_tip_offset(self: _A, dx: float, dy: float, dz: float = 0.0) -> _A:
        """Return the arm with its tip moved by dx, dy, dz [m].

        In space along the axes of the tip's own frame; of a planar arm along its last link, to the
        left of it, and off the plane.
        """
        offset = np.array([dx, dy, dz], dtype=float)
        tip = self.chain.tip + offset @ self._tip_axes
        return replace(self, chain=replace(self.chain, tip=tip))

    @property
    def _tip_axes(self) -> Array:
        """Directions (3, 3) of a tip's offset, at zero, in the root link's frame."""
        return self.chain.rotation.T

    @property
    def dof(self) -> int:
        """Number of active joints."""
        return len(self.joint_names)

    @property
    def units_of_joints(self) -> tuple[str, ...]:
        """Unit of each joint's value."""
        return tuple("rad" if turns else "m" for turns in self.revolute)

    def with_range(self: _A, ranges: Mapping[str, Range]) -> _A:
        """Return the arm with only a part, (lower, upper) [rad or m], of some joints' ranges.

        Of joints that can turn more than once it is one turn.
        """
        lower = self.lower.copy()
        upper = self.upper.copy()
        travel = list(self.travel)
        turning: dict[str, Range] = {}
        for name, chosen in ranges.items():
            k = self._joint_number(name, "ranges")
            if chosen != self.limits[k]:
                chosen = clip_range(
                    name, chosen, self.limits[k], self.units_of_joints[k]
                )
            travel[k] = chosen
            lower[k], upper[k] = learned_range(chosen, self.revolute[k])
            if self.revolute[k]:
                turning[name] = chosen
        notes = (*self.notes, *notes_of_turns(turning))
        return replace(
            self, lower=lower, upper=upper, travel=tuple(travel), notes=notes
        )

    def _links(self) -> Array:
        """Vectors (dof, 3) [m] from each active joint to the next, the last to the tip, at zero."""
        points = self.chain.points[self._active_places]
        return np.diff(np.vstack([points, self.chain.tip]), axis=0)

    @property
    def _active_places(self) -> list[int]:
        """Places in the chain of the active joints themselves, not of their followers."""
        places: list[int] = []
        is_unbiased = self.chain.bias == 0
        for unit in np.eye(self.dof):
            is_leader = (self.chain.coupling == unit).all(axis=1) & is_unbiased
            places.append(int(np.flatnonzero(is_leader)[0]))
        return places

    def _by_rows(
        self, q: ArrayLike, compute: Callable[[Array], Array]
    ) -> Array:
        """Compute something of joint values, some rows at a time; of one vector its only row."""
        rows, single = query_rows(q, self.joint_names, "joint values")
        starts = range(0, max(len(rows), 1), _CACHED)
        out = np.concatenate(
            [compute(rows[start : start + _CACHED]) for start in starts]
        )
        return out[0] if single else out

    def _joint_number(self, joint: str, what: str) -> int:
        """Number of an active joint; `what` is the option that names it."""
        if joint not in self.joint_names:
            raise OptionError(
                f"`{what}`: {quoted(joint)} is not an active joint: "
                f"{suggestion(joint, self.joint_names)}"
            )
        return self.joint_names.index(joint)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
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

        def positions(rows: Array) -> Array:
            points, _ = self.chain.poses(rows)
            return self.plane.project(points)

        return self._by_rows(q, positions)

    def jacobian(self, q: ArrayLike) -> Array:
        """Derivatives of the position by the joint values, (n, 2, dof) or (2, dof)."""
        axes = np.stack([self.plane.x, self.plane.y])
        return self._by_rows(
            q, lambda rows: axes @ self.chain.jacobian(rows)[:, :3]
        )

    def _links(self) -> Array:
        """Vectors within the plane, at zero (dof, 3) [m]."""
        links = super()._links()
        normal = self.plane.normal
        return links - np.outer(links @ normal, normal)

    @property
    def _tip_axes(self) -> Array:
        """Along the last link, or the plane's x axis where it has no length; left of it; normal."""
        along = self._links()[-1]
        length = float(np.linalg.norm(along))
        along = along / length if length >= _MIN_LENGTH else self.plane.x
        normal = self.plane.normal
        return np.stack([along, np.cross(normal, along), normal])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SpatialArm(Arm):
    """A spatial arm: joints, limits, tip and kinematics.

    Mimic joints on the way to the tip follow their leader; they are part of `chain` and not of
    `joint_names`.
    """

    outputs = 3


def clip_range(name: str, chosen: Range, limits: Range, unit: str) -> Range:
    """Return a range that the user chose, clipped into the limits if only rounding is over.

    Raises OptionError if it is not finite, empty or inverted, or goes beyond the joint's limits.
    """
    lower, upper = (float(end) for end in chosen)
    within = limits[0] - _ROUNDING <= lower < upper <= limits[1] + _ROUNDING
    if not (within and math.isfinite(upper - lower)):
        raise OptionError(
            f"`ranges={{{name!r}: ({lower:g}, {upper:g})}}`: expected two finite numbers, lower "
            f"one first, within the joint's limits {limits[0]:.6g}:{limits[1]:.6g} [{unit}]",
            parameter="ranges",
            value=(lower, upper),
        )
    return max(lower, limits[0]), min(upper, limits[1])


def learned_range(travel: Range, revolute: bool) -> Range:
    """Return what is learned of a joint's travel: of a turning joint at most one turn.

    It is centred as near to 0 as the travel allows.
    """
    lower, upper = travel
    if not revolute or upper - lower <= TURN:
        return travel
    # the turn around 0 where the range holds it, else the end that is nearest to 0
    centre = min(max(0.0, lower + TURN / 2), upper - TURN / 2)
    return centre - TURN / 2, centre + TURN / 2


def notes_of_turns(chosen: Mapping[str, Range]) -> list[str]:
    """Return a note on the turning joints whose ranges are cut to one turn, if there are any."""
    cut = [
        repr(name)
        for name, (low, high) in chosen.items()
        if high - low > TURN + _ROUNDING
    ]
    if not cut:
        return []
    note = (
        f"{listing(cut)} can turn more than once: one turn of each is learned"
    )
    finite = [high for _, high in chosen.values() if high <= 360.0]
    largest = max(finite, default=0.0)
    if largest > 2.0 * TURN:
        note += (
            f"; limits of {largest:g} rad: if they are in degrees, correct them"
        )
    return [note]
