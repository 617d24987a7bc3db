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
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Shape
from ..common.frozen import own_floats
from .rotations import cross_matrix, exponential

#: Standard gravity in the root frame of an arm that stands upright [m/s2].
GRAVITY = (0.0, 0.0, -9.80665)


@dataclass(frozen=True)
class Deviations:
    """How a chain differs from its nominal one."""

    shifts: Array  # (m, 3) [m], of the joint origins, along the axes of the frame before
    turns: Array  # (m, 3) [rad], rotation vectors of the joint origins
    tool: Array  # (3,) [m], of the tip, along the axes of its own frame
    tool_turn: Array  # (3,) [rad]

    @staticmethod
    def none(joints: int) -> Deviations:
        """Those of the nominal chain."""
        zeros = np.zeros((joints, 3))
        return Deviations(zeros, zeros, np.zeros(3), np.zeros(3))


@dataclass(frozen=True)
class Motion:
    """Where a chain is at n rows, and the directions in which each part of it moves the tip."""

    position: Array  # (3, n) [m]
    rotation: Array  # (3, 3, n), orientation of the tip's frame
    origins: Array  # (m, 3, n) [m]
    places: Array  # (m, 3, n) [m], the same after each joint has slid
    # (m + 1) of (3, 3, n), orientation of the root and of the frame beyond each joint
    frames: tuple[Array, ...]
    turned: tuple[Array, ...]  # (m) of (3, 3, n), frames of the joint origins after their own turn
    axes: Array  # (m, 3, n)
    flange: Array  # (3, 3, n), axes of the tip's frame before its own turn
    revolute: tuple[bool, ...]

    def joints(self) -> tuple[Array, Array]:
        """Velocity (m, 3, n) and angular velocity (m, 3, n) of the tip as each joint moves."""
        velocity, angular = self.axes.copy(), np.zeros_like(self.axes)
        for i in np.flatnonzero(self.revolute):
            velocity[i] = cross(self.axes[i], self.position - self.origins[i])
            angular[i] = self.axes[i]
        return velocity, angular

    def turns(self) -> tuple[Array, Array]:
        """The same (m, 3, 3, n) as the origins turn about the axes, second, of their own frames."""
        about = np.swapaxes(np.stack(self.turned), 1, 2)
        return np.cross(about, (self.position - self.origins)[:, None], axis=2), about


class Placements(NamedTuple):
    """A chain as links between frames: what Pinocchio and the exported C are made of."""

    strides: Array  # (m, 3) [m], from each joint's origin to the next, in the frame before
    turns: Array  # (m, 3, 3), turn of each joint's origin against the frame before
    tip: Array  # (3,) [m], place of the tip in the last joint's frame
    tip_turn: Array  # (3, 3), its orientation there


@dataclass(frozen=True, eq=False)
class SpatialChain:
    """A serial chain of m joints that are moved by dof values, at its zero posture."""

    axes: Annotated[Array, Shape("m", 3)]  # unit axes in the root frame, base to tip
    # [m], origins of the joint frames; the axes pass through them
    points: Annotated[Array, Shape("m", 3)]
    tip: Annotated[Array, Shape(3)]  # [m], position of the tip
    rotation: Annotated[Array, Shape(3, 3)]  # orientation of the tip's frame
    revolute: tuple[bool, ...]  # whether each joint turns about its axis or slides along it
    # (m, dof), how much each joint follows each active value: the unit matrix without mimic joints
    coupling: Annotated[Array, Shape("m", "dof")]
    bias: Annotated[Array, Shape("m")]  # [rad or m], offset of each mimic joint, else 0
    # (m,) [kg], mass that each joint carries up to the next joint; empty where the URDF states none
    masses: Annotated[Array, Shape("w")] = field(default_factory=lambda: np.zeros(0))
    # (m, 3) [m], centres of those masses at the zero posture
    centres: Annotated[Array, Shape("w", 3)] = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        own_floats(self, "axes", "points", "tip", "rotation", "coupling", "bias")
        own_floats(self, "masses", "centres")

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
        return float(np.linalg.norm(np.diff(stops, axis=0), axis=1).sum())

    def values(self, q: Array) -> Array:
        """Values of all joints: (n, dof) [rad or m] -> (m, n)."""
        return np.asarray(self.coupling @ q.T + self.bias[:, None])

    def motion(self, q: Array) -> Motion:
        """Where its parts are at joint values (n, dof) [rad or m]."""
        return move(self, self.values(q))

    def positions(self, q: Array) -> Array:
        """Positions of the tip: (n, dof) -> (n, 3) [m].

        The zero posture's tip, moved by the joints from the last to the first (Brockett's product
        of exponentials): ten times faster than `motion`, which turns whole matrices.
        """
        values = self.values(q)
        tip = np.repeat(self.tip[:, None], len(q), axis=1)
        for i in reversed(range(self.joints)):
            if self.revolute[i]:
                point, axis = self.points[i][:, None], self.axes[i][:, None]
                # Rodrigues, by cross products: BLAS would round one row otherwise than many
                across = cross(axis, tip - point)
                tip = tip + np.sin(values[i]) * across
                tip = tip + (1.0 - np.cos(values[i])) * cross(axis, across)
            else:
                tip = tip + self.axes[i][:, None] * values[i]
        return np.ascontiguousarray(tip.T)

    def poses(self, q: Array) -> tuple[Array, Array]:
        """Positions (n, 3) [m] and orientations (n, 3, 3) of the tip's frame."""
        # the motion's tip differs in the last bit: a pose's position is what `positions` gives
        return self.positions(q), np.moveaxis(self.motion(q).rotation, 2, 0).copy()

    def jacobian(self, q: Array) -> Array:
        """Geometric Jacobian of the tip in the root frame: (n, dof) -> (n, 6, dof).

        Rows 0 to 2 are velocities of the tip's point [m/rad or 1], rows 3 to 5 angular
        velocities of its frame [1 or 0].
        """
        twists = np.concatenate(self.motion(q).joints(), axis=1)
        return np.asarray(twists.transpose(2, 1, 0) @ self.coupling)

    def skeleton(self, q: Array) -> Array:
        """Joint origins and the tip, to draw the arm: (n, dof) -> (n, m + 1, 3) [m]."""
        motion = self.motion(q)
        stops = np.concatenate([motion.places, motion.position[None]])
        return np.ascontiguousarray(np.moveaxis(stops, 2, 0))

    def torques(self, q: Array, gravity: ArrayLike = GRAVITY) -> Array:
        """Torque of gravity (3,) [m/s2] about each axis: (n, dof) -> (n, m) [N m; N of a slide]."""
        motion, out = self.motion(q), np.empty((len(q), self.joints))
        away, g = self.centres - self.points, np.asarray(gravity, dtype=float)[:, None]
        moment, weight = np.zeros((3, len(q))), 0.0  # of the masses beyond, about the root
        for i in reversed(range(self.joints)):
            centre = motion.places[i] + turned(motion.frames[i + 1], away[i])
            moment, weight = moment + self.masses[i] * centre, weight + self.masses[i]
            about = moment - weight * motion.places[i]
            pull = cross(about, g) if self.revolute[i] else weight * g
            out[:, i] = (motion.axes[i] * pull).sum(axis=0)
        return out

    def placements(self, moved: Deviations | None = None) -> Placements:
        """Its links, of the nominal chain where no deviations are given."""
        moved = moved or Deviations.none(self.joints)
        return Placements(
            np.diff(self.points, axis=0, prepend=np.zeros((1, 3))) + moved.shifts,
            exponential(moved.turns),
            self.tip - self.points[-1] + self.rotation @ moved.tool,
            self.rotation @ exponential(moved.tool_turn),
        )


def move(chain: SpatialChain, values: Array, moved: Deviations | None = None) -> Motion:
    """Evaluate a chain at the values (m, n) of its joints [rad or m]."""
    m, n = values.shape
    moved = moved or Deviations.none(m)
    # coordinates come first and rows last, so that every operation runs along the rows
    origins, places, axes = np.empty((3, m, 3, n))
    frames, after = [np.repeat(np.eye(3)[:, :, None], n, axis=2)], []
    position, last = np.zeros((3, n)), np.zeros(3)
    turns = exponential(moved.turns)
    for i in range(m):
        rotation = frames[-1]
        position = position + turned(rotation, chain.points[i] - last + moved.shifts[i])
        last = chain.points[i]
        if moved.turns[i].any():
            rotation = _times(rotation, turns[i])
        axes[i] = turned(rotation, chain.axes[i])
        origins[i] = position
        after.append(rotation)
        if chain.revolute[i]:
            rotation = _rotated(rotation, chain.axes[i], values[i])
        else:
            position = position + axes[i] * values[i]
        places[i] = position
        frames.append(rotation)
    flange = _times(frames[-1], chain.rotation)
    position = position + turned(frames[-1], chain.tip - last) + turned(flange, moved.tool)
    tip = _times(flange, exponential(moved.tool_turn))
    return Motion(
        position, tip, origins, places, tuple(frames), tuple(after), axes, flange, chain.revolute
    )


def cross(a: Array, b: Array) -> Array:
    """Cross products of columns: (3, n) x (3, n) -> (3, n)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def turned(rotation: Array, vector: Array) -> Array:
    """Turn one vector (3,) by many rotations (3, 3, n): (3, n)."""
    x, y, z = vector
    return np.asarray(rotation[:, 0] * x + rotation[:, 1] * y + rotation[:, 2] * z)


def _times(rotation: Array, matrix: Array) -> Array:
    """Multiply many rotations (3, 3, n) by one matrix (3, 3) from the right."""
    rows = matrix[:, :, None]  # no BLAS: it would round one row otherwise than many
    out = rotation[:, :1] * rows[0] + rotation[:, 1:2] * rows[1] + rotation[:, 2:] * rows[2]
    return np.asarray(out)


def _rotated(rotation: Array, axis: Array, angle: Array) -> Array:
    """Multiply rotations (3, 3, n) by turns about one constant unit axis by angles (n,)."""
    # Rodrigues: exp = 1 + sin(v) K + (1 - cos(v)) K^2 with K^2 = a a' - 1
    cosine, swung = np.cos(angle), 1.0 - np.cos(angle)
    out = np.sin(angle) * _times(rotation, cross_matrix(axis))
    out += cosine * rotation
    out += (swung * turned(rotation, axis))[:, None] * axis[:, None]
    return out
