"""Spatial chain: position, orientation and Jacobian of a serial chain, vectorised over rows.

Every constant transform is folded into the posture where all joints are zero: a chain is a list of
axes a_i and points c_i.  A joint's origin may be off the drawing, by a shift d_i and a turn w_i:

    o_i = o_{i-1} + R_{i-1} (c_i - c_{i-1} + d_i),  E_i = R_{i-1} exp(w_i),  R_i = E_i exp(a_i v_i)

with the value v_i, and R_{-1} = 1.  A sliding joint adds E_i a_i v_i to o_i instead.  A mimic joint
is one more joint whose value follows another's: v = coupling q + bias.  The over-complete
deviations, with a prior, need no convention for nearly parallel axes (Denavit-Hartenberg does).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import numpy as np

from ..common.arrays import Array, Shape, freeze_copies
from ..common.rows import row_lengths
from .rotations import cross_matrix, exponential


@dataclass(frozen=True)
class Deviations:
    """How a chain differs from its nominal one."""

    shifts: Array  # (m, 3) [m], of the joint origins, along the axes of the frame before
    turns: Array  # (m, 3) [rad], rotation vectors of the joint origins
    tool: Array  # (3,) [m], of the tip, along the axes of the last frame
    tool_turn: Array  # (3,) [rad]

    @staticmethod
    def none(joints: int) -> Deviations:
        """Those of the nominal chain."""
        zeros = np.zeros((joints, 3))
        return Deviations(zeros, zeros, np.zeros(3), np.zeros(3))


@dataclass(frozen=True)
class ChainState:
    """Where a chain is at n rows, and the directions in which each part of it moves the tip."""

    position: Array  # (3, n) [m]
    rotation: Array  # (3, 3, n), orientation of the tip's frame
    origins: Array  # (m, 3, n) [m]
    places: Array  # (m, 3, n) [m], the same after each joint has slid
    frames: Array  # (m + 1, 3, 3, n), orientation of the root and of the frame beyond each joint
    axes: Array  # (m, 3, n)
    flange: Array  # (3, 3, n), axes of the tip's frame before its own turn
    links: Links

    def joints(self) -> tuple[Array, Array]:
        """Velocity (m, 3, n) and angular velocity (m, 3, n) of the tip as each joint moves."""
        swept = cross(self.axes, self.position - self.origins)
        turning = self.links.turning
        if turning.all():
            return swept, self.axes
        velocities = np.where(turning, swept, self.axes)
        turns_of_tip = np.where(turning, self.axes, 0.0)
        return velocities, turns_of_tip

    def turns(self) -> tuple[Array, Array]:
        """Velocity and angular velocity (m, 3, 3, n) of the tip by turns of the origins.

        Each origin turns about the axes, the second index, of its own frame.
        """
        own_frames = _product(self.frames[:-1], self.links.rotations[..., None])
        axes = np.swapaxes(own_frames, 1, 2)
        arms = self.position - self.origins
        swept = np.cross(axes, arms[:, None], axis=2)
        return swept, axes


@dataclass(frozen=True, eq=False)
class SpatialChain:
    """A serial chain of m joints that are moved by dof values, at its zero posture."""

    # unit axes in the root frame, base to tip
    axes: Annotated[Array, Shape("m", 3)]
    # [m], origins of the joint frames; the axes pass through them
    points: Annotated[Array, Shape("m", 3)]
    tip: Annotated[Array, Shape(3)]  # [m], position of the tip
    rotation: Annotated[Array, Shape(3, 3)]  # orientation of the tip's frame
    # whether each joint turns about its axis or slides along it
    revolute: tuple[bool, ...]
    # (m, dof), how much each joint follows each active value: the unit matrix without mimic joints
    coupling: Annotated[Array, Shape("m", "dof")]
    # [rad or m], offset of each mimic joint, else 0
    bias: Annotated[Array, Shape("m")]
    # (m,) [kg], mass that each joint carries up to the next joint; empty where the URDF states none
    masses: Annotated[Array, Shape("w")] = field(
        default_factory=lambda: np.zeros(0)
    )
    # (m, 3) [m], centres of those masses at the zero posture
    centres: Annotated[Array, Shape("w", 3)] = field(
        default_factory=lambda: np.zeros((0, 3))
    )

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        freeze_copies(
            self, "axes", "points", "tip", "rotation", "coupling", "bias"
        )
        freeze_copies(self, "masses", "centres")

    @property
    def joints(self) -> int:
        """Number m of joints, mimic joints included."""
        return len(self.revolute)

    @property
    def leaders(self) -> tuple[int, ...]:
        """The active value that each joint follows, (m,)."""
        return tuple(int(k) for k in np.argmax(self.coupling != 0, axis=1))

    @property
    def reach(self) -> float:
        """Sum of the distances from the first joint over the others to the tip [m]."""
        stops = np.vstack([self.points, self.tip])
        strides = np.diff(stops, axis=0)
        return float(row_lengths(strides).sum())

    def values(self, q: Array) -> Array:
        """Values of all joints: (n, dof) [rad or m] -> (m, n)."""
        return self.coupling @ q.T + self.bias[:, None]

    def state(self, q: Array) -> ChainState:
        """Where its parts are at joint values (n, dof) [rad or m]."""
        return move(self.nominal_links, self.values(q))

    def poses(self, q: Array) -> tuple[Array, Array]:
        """Positions (n, 3) [m] and orientations (n, 3, 3) of the tip's frame."""
        state = self.state(q)
        positions = np.ascontiguousarray(state.position.T)
        orientations = np.moveaxis(state.rotation, 2, 0).copy()
        return positions, orientations

    def jacobian(self, q: Array) -> Array:
        """Geometric Jacobian of the tip in the root frame: (n, dof) -> (n, 6, dof).

        Rows 0 to 2 are velocities of the tip's point [m/rad or 1], rows 3 to 5 angular
        velocities of its frame [1 or 0].
        """
        twists = np.concatenate(self.state(q).joints(), axis=1)
        return twists.transpose(2, 1, 0) @ self.coupling

    @cached_property
    def nominal_links(self) -> Links:
        """The links of the nominal chain."""
        return Links.of(self, Deviations.none(self.joints))


@dataclass(frozen=True, eq=False)
class Links:
    """The constants of a chain with deviations, those of all joints side by side."""

    strides: Array  # (m + 1, 3, 1) [m], from each joint's origin to the next, in the frame before
    axes: Array  # (m, 3, 1), in the frame before
    rotations: Array  # (m, 3, 3), of the joint origins
    sines: Array  # (m, 3, 3, 1), what a joint adds to that by the sine of its angle
    swings: Array  # (m, 3, 3, 1), and by one less the cosine
    turning: Array  # (m, 1, 1), whether each joint turns
    rotation: Array  # (3, 3), orientation of the flange
    tool: Array  # (3, 1) [m]
    tool_rotation: Array | None  # (3, 3); None where it does not turn

    @property
    def tip(self) -> tuple[Array, Array]:
        """Place (3,) [m] and orientation (3, 3) of the tip in the last joint's frame."""
        place = self.strides[-1] + self.rotation @ self.tool
        orientation = self.rotation
        if self.tool_rotation is not None:
            orientation = self.rotation @ self.tool_rotation
        return place[:, 0], orientation

    @staticmethod
    def of(chain: SpatialChain, deviations: Deviations) -> Links:
        """The links of a chain that is off its drawing."""
        strides = np.diff(chain.points, axis=0, prepend=np.zeros((1, 3)))
        strides += deviations.shifts
        to_tip = chain.tip - chain.points[-1]
        axes = chain.axes[..., None]
        rotations = exponential(deviations.turns)
        # Rodrigues: exp = 1 + sin(v) K + (1 - cos(v)) K^2
        about = cross_matrix(chain.axes)
        sines = rotations @ about
        swings = sines @ about
        tool_rotation: Array | None = None
        if deviations.tool_turn.any():
            tool_rotation = exponential(deviations.tool_turn)
        return Links(
            strides=np.vstack([strides, to_tip])[..., None],
            axes=rotations @ axes,
            rotations=rotations,
            sines=sines[..., None],
            swings=swings[..., None],
            turning=np.reshape(chain.revolute, (-1, 1, 1)),
            rotation=chain.rotation,
            tool=deviations.tool[:, None],
            tool_rotation=tool_rotation,
        )


def move(links: Links, values: Array) -> ChainState:
    """Evaluate a chain at the values (m, n) of its joints [rad or m]."""
    m, n = values.shape
    # coordinates come first and rows last, so that every operation runs along the rows
    angles = values[:, None, None]
    local = links.rotations[..., None] + np.sin(angles) * links.sines
    local += (1.0 - np.cos(angles)) * links.swings
    slides = not links.turning.all()
    if slides:
        turning = links.turning[..., None]
        local = np.where(turning, local, links.rotations[..., None])
    frames = np.empty((m + 1, 3, 3, n))
    frames[0] = np.eye(3)[:, :, None]
    frames[1] = local[0]
    for i in range(1, m):
        frames[i + 1] = _product(frames[i], local[i])
    axes = rotate(frames[:-1], links.axes)
    steps = rotate(frames, links.strides)
    if slides:  # a slide moves all that comes after it
        slid = np.where(links.turning, 0.0, axes * values[:, None])
        steps[1:] += slid
    stops = np.cumsum(steps, axis=0)
    origins = places = stops[:-1]
    if slides:
        places = origins + slid
    flange = _product(frames[-1], links.rotation[..., None])
    position = stops[-1] + rotate(flange, links.tool)
    tip = flange
    if links.tool_rotation is not None:
        tip = _product(flange, links.tool_rotation[..., None])
    return ChainState(
        position, tip, origins, places, frames, axes, flange, links
    )


def cross(a: Array, b: Array) -> Array:
    """Cross products of columns: (..., 3, n) x (..., 3, n) -> (..., 3, n)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    (ax, ay, az), (bx, by, bz) = (
        (part[..., 0, :], part[..., 1, :], part[..., 2, :]) for part in (a, b)
    )
    out[..., 0, :] = ay * bz - az * by
    out[..., 1, :] = az * bx - ax * bz
    out[..., 2, :] = ax * by - ay * bx
    return out


def rotate(rotations: Array, vectors: Array) -> Array:
    """Vectors (..., 3, n or 1) turned by rotations (..., 3, 3, n), (..., 3, n)."""
    x, y, z = (vectors[..., None, k, :] for k in range(3))
    out = rotations[..., 0, :] * x + rotations[..., 1, :] * y
    out += rotations[..., 2, :] * z
    return out


def _product(a: Array, b: Array) -> Array:
    """Products of matrices (..., 3, 3, n or 1); no BLAS, which would round one row otherwise."""
    return np.asarray(np.einsum("...ijn,...jkn->...ikn", a, b))
