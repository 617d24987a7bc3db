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
from typing import Annotated

import numpy as np

from ..common.arrays import Array, Shape
from ..common.frozen import own_floats
from .motion import Motion, cross, move, turned

#: Standard gravity in the root frame of an arm that stands upright [m/s2].
GRAVITY = (0.0, 0.0, -9.80665)


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
        motion = self.motion(q)
        twists = [np.concatenate(motion.joint(i, turns)) for i, turns in enumerate(self.revolute)]
        return np.asarray(np.stack(twists, axis=-1).transpose(1, 0, 2) @ self.coupling)

    def skeleton(self, q: Array) -> Array:
        """Joint origins and the tip, to draw the arm: (n, dof) -> (n, m + 1, 3) [m]."""
        motion = self.motion(q)
        stops = np.concatenate([motion.places, motion.position[None]])
        return np.ascontiguousarray(np.moveaxis(stops, 2, 0))

    def torques(self, q: Array, gravity: Array | None = None) -> Array:
        """Torque of gravity about each joint's axis: (n, dof) -> (n, m) [N m; N of a slide].

        `gravity` is (3,) [m/s2] in the root frame; by default it points down its z axis.
        """
        g = np.asarray(GRAVITY if gravity is None else gravity, dtype=float)
        motion, moments, weights = self._moments(q)
        out = np.empty((len(q), self.joints))
        for i in range(self.joints):
            pull = cross(moments[i], g[:, None]) if self.revolute[i] else weights[i] * g[:, None]
            out[:, i] = (motion.axes[i] * pull).sum(axis=0)
        return out

    def _moments(self, q: Array) -> tuple[Motion, Array, Array]:
        """Motion, first moments of mass beyond each joint about it (m, 3, n), and masses (m,)."""
        motion = self.motion(q)
        away = self.centres - self.points
        centres = motion.places + np.stack(
            [turned(frame, arm) for frame, arm in zip(motion.frames[1:], away, strict=True)]
        )
        weights = np.cumsum(self.masses[::-1])[::-1]
        beyond = np.cumsum((self.masses[:, None, None] * centres)[::-1], axis=0)[::-1]
        return motion, beyond - weights[:, None, None] * motion.places, weights
