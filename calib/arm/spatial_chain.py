"""Spatial chain: position, orientation and Jacobian of a serial chain, vectorised over rows.

Every constant transform is folded into the posture where all joints are zero. There each joint
frame has the root's orientation, so that a chain is a list of axes and of points:

    o_i = o_{i-1} + R_{i-1} (c_i - c_{i-1}),   R_i = R_{i-1} exp(a_i v_i)

with the axis a_i and the point c_i of joint i, its value v_i, and R_{-1} = 1. A sliding joint
adds R_{i-1} a_i v_i to o_i instead. A mimic joint is one more joint of the chain whose value
follows another's: v = coupling q + bias.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array
from ..common.frozen import own_floats
from .rotations import cross_matrix

#: Standard gravity in the root frame of an arm that stands upright [m/s2].
GRAVITY = (0.0, 0.0, -9.80665)


class Frames(NamedTuple):
    """World positions and axes of a chain's joints at n rows."""

    origins: Array  # (m, 3, n) [m]
    axes: Array  # (m, 3, n)
    tip: Array  # (3, n) [m]
    rotation: Array  # (3, 3, n), orientation of the tip's frame


@dataclass(frozen=True, eq=False)
class SpatialChain:
    """A serial chain of m joints that are moved by dof values, at its zero posture."""

    axes: Array  # (m, 3), unit axes in the root frame, base to tip
    points: Array  # (m, 3) [m], origins of the joint frames; the axes pass through them
    tip: Array  # (3,) [m], position of the tip
    rotation: Array  # (3, 3), orientation of the tip's frame
    revolute: tuple[bool, ...]  # whether each joint turns about its axis or slides along it
    # (m, dof), how much each joint follows each active value: the unit matrix without mimic joints
    coupling: Array
    bias: Array  # (m,) [rad or m], offset of each mimic joint, else 0
    # (m,) [kg], mass that each joint carries up to the next joint; empty where the URDF states none
    masses: Array = field(default_factory=lambda: np.zeros(0))
    # (m, 3) [m], centres of those masses at the zero posture
    centres: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        own_floats(self, "axes", "points", "tip", "rotation", "coupling", "bias")
        own_floats(self, "masses", "centres")

    @property
    def joints(self) -> int:
        """Number m of joints, mimic joints included."""
        return len(self.revolute)

    @property
    def dof(self) -> int:
        """Number of active joint values."""
        return int(self.coupling.shape[1])

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

    def frames(self, q: Array) -> Frames:
        """World positions and axes at joint values (n, dof) [rad or m]."""
        n, m = len(q), self.joints
        values = self.values(q)
        origins, axes = np.empty((m, 3, n)), np.empty((m, 3, n))
        rotation = np.repeat(np.eye(3)[:, :, None], n, axis=2)
        position = np.zeros((3, n))
        before = np.zeros(3)
        for i in range(m):
            position = position + turned(rotation, self.points[i] - before)
            before = self.points[i]
            axes[i] = turned(rotation, self.axes[i])
            if self.revolute[i]:
                rotation = rotated(rotation, self.axes[i], values[i])
            else:
                position = position + axes[i] * values[i]
            origins[i] = position
        tip = position + turned(rotation, self.tip - before)
        return Frames(origins, axes, tip, times(rotation, self.rotation))

    def positions(self, q: Array) -> Array:
        """Positions of the tip: (n, dof) -> (n, 3) [m].

        The zero posture's tip, moved by the joints from the last to the first (Brockett's product
        of exponentials): ten times faster than `frames`, which turns whole matrices.
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
        # the frames' tip differs in the last bit: a pose's position is what `positions` gives
        return self.positions(q), np.moveaxis(self.frames(q).rotation, 2, 0).copy()

    def jacobian(self, q: Array) -> Array:
        """Geometric Jacobian of the tip in the root frame: (n, dof) -> (n, 6, dof).

        Rows 0 to 2 are velocities of the tip's point [m/rad or 1], rows 3 to 5 angular
        velocities of its frame [1 or 0].
        """
        frames = self.frames(q)
        columns = np.zeros((len(q), 6, self.joints))
        for i in range(self.joints):
            axis = frames.axes[i]
            if self.revolute[i]:
                columns[:, :3, i] = cross(axis, frames.tip - frames.origins[i]).T
                columns[:, 3:, i] = axis.T
            else:
                columns[:, :3, i] = axis.T
        return np.asarray(columns @ self.coupling)

    def velocities(self, q: Array) -> Array:
        """Its first three rows alone, (n, 3, dof): as `positions`, without turned matrices."""
        values = self.values(q)
        moved = np.zeros((3, self.joints + 1, len(q)))  # by each joint; last the tip itself
        tip = moved[:, -1]
        tip += self.tip[:, None]
        for i in reversed(range(self.joints)):
            axis, point = self.axes[i][:, None], self.points[i][:, None]
            if self.revolute[i]:
                tip -= point
                across = cross(axis[..., None], moved[:, i + 1 :])
                moved[:, i + 1 :] += np.sin(values[i]) * across
                moved[:, i + 1 :] += (1.0 - np.cos(values[i])) * cross(axis[..., None], across)
                moved[:, i] = cross(axis, tip)
                tip += point
            else:
                moved[:, i] = axis
                tip += axis * values[i]
        return np.asarray(np.moveaxis(moved[:, :-1], 2, 0) @ self.coupling)

    def skeleton(self, q: Array) -> Array:
        """Joint origins and the tip, to draw the arm: (n, dof) -> (n, m + 1, 3) [m]."""
        frames = self.frames(q)
        stops = np.concatenate([frames.origins, frames.tip[None]])
        return np.ascontiguousarray(np.moveaxis(stops, 2, 0))

    def torques(self, q: Array, gravity: Array | None = None) -> Array:
        """Torque of gravity about each joint's axis: (n, dof) -> (n, m) [N m; N of a slide].

        `gravity` is (3,) [m/s2] in the root frame; by default it points down its z axis.
        """
        g = np.asarray(GRAVITY if gravity is None else gravity, dtype=float)
        frames, moments, weights = self._moments(q)
        out = np.empty((len(q), self.joints))
        for i in range(self.joints):
            pull = cross(moments[i], g[:, None]) if self.revolute[i] else weights[i] * g[:, None]
            out[:, i] = (frames.axes[i] * pull).sum(axis=0)
        return out

    def torque_slopes(self, q: Array, gravity: Array | None = None) -> Array:
        """Derivative (n, m, dof) of `torques` by the joint values.

        Torques are minus the gradient of the potential energy, so the derivative by the
        joints' values is symmetric: joint j moves all that joint i >= j carries as one body.
        """
        g = np.asarray(GRAVITY if gravity is None else gravity, dtype=float)[:, None]
        frames, moments, weights = self._moments(q)
        out = np.zeros((len(q), self.joints, self.joints))
        for i in range(self.joints):
            axis = frames.axes[i]
            for j in range(i + 1):
                if not self.revolute[j]:  # a slide shifts what lies beyond, turns nothing
                    continue
                turn = cross(frames.axes[j], axis)
                if self.revolute[i]:
                    swept = cross(frames.axes[j], moments[i])
                    slope = (turn * cross(moments[i], g)).sum(axis=0)
                    slope = slope + (axis * cross(swept, g)).sum(axis=0)
                else:
                    slope = (turn * g).sum(axis=0) * weights[i]
                out[:, i, j] = out[:, j, i] = slope
        return np.asarray(out @ self.coupling)

    def _moments(self, q: Array) -> tuple[Frames, Array, Array]:
        """Frames, first moments of mass beyond each joint about it (m, 3, n), and masses (m,)."""
        frames = self.frames(q)
        values = self.values(q)
        rotation = np.repeat(np.eye(3)[:, :, None], len(q), axis=2)
        centres = np.empty((self.joints, 3, len(q)))
        for i in range(self.joints):
            if self.revolute[i]:
                rotation = rotated(rotation, self.axes[i], values[i])
            centres[i] = frames.origins[i] + turned(rotation, self.centres[i] - self.points[i])
        weights = np.cumsum(self.masses[::-1])[::-1]
        weighted = self.masses[:, None, None] * centres
        beyond = np.cumsum(weighted[::-1], axis=0)[::-1]
        return frames, beyond - weights[:, None, None] * frames.origins, weights


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


def times(rotation: Array, matrix: Array) -> Array:
    """Multiply many rotations (3, 3, n) by one matrix (3, 3) from the right."""
    out = np.empty_like(rotation)
    for k in range(3):
        out[:, k] = turned(rotation, matrix[:, k])
    return out


def rotated(rotation: Array, axis: Array, angle: Array) -> Array:
    """Multiply rotations (3, 3, n) by turns about one constant unit axis by angles (n,)."""
    k = cross_matrix(axis)
    # Rodrigues: exp = 1 + sin(v) K + (1 - cos(v)) K^2 with K^2 = a a' - 1
    cosine, swung = np.cos(angle), 1.0 - np.cos(angle)
    out = np.sin(angle) * times(rotation, k)
    out += cosine * rotation
    out += (swung * turned(rotation, axis))[:, None] * axis[:, None]
    return out
