"""Motion of a spatial chain, vectorised over rows; its joint origins may be off the drawing.

Each joint origin i is moved by a shift d_i and a turn w_i against its nominal place:

    o_i = o_{i-1} + R_{i-1} (t_i + d_i),   E_i = R_{i-1} exp(w_i),   R_i = E_i exp(a_i v_i)

An over-complete parametrisation with a prior on the nominal place needs no convention for nearly
parallel axes (Denavit-Hartenberg does), and slides and turns are treated alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ..common.arrays import Array
from .rotations import cross_matrix, exponential


class Links(Protocol):
    """What `move` needs of a chain at its zero posture; see `SpatialChain`."""

    @property
    def axes(self) -> Array: ...  # noqa: D102
    @property
    def points(self) -> Array: ...  # noqa: D102
    @property
    def tip(self) -> Array: ...  # noqa: D102
    @property
    def rotation(self) -> Array: ...  # noqa: D102
    @property
    def revolute(self) -> tuple[bool, ...]: ...  # noqa: D102


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


class Placements(NamedTuple):
    """A chain as links between frames: what Pinocchio and the exported C are made of."""

    strides: Array  # (m, 3) [m], from each joint's origin to the next, in the frame before
    turns: Array  # (m, 3, 3), turn of each joint's origin against the frame before
    tip: Array  # (3,) [m], place of the tip in the last joint's frame
    tip_turn: Array  # (3, 3), its orientation there


def placements(chain: Links, moved: Deviations | None = None) -> Placements:
    """The links of a chain, of its nominal one where no deviations are given."""
    moved = moved or Deviations.none(len(chain.revolute))
    return Placements(
        np.diff(chain.points, axis=0, prepend=np.zeros((1, 3))) + moved.shifts,
        exponential(moved.turns),
        chain.tip - chain.points[-1] + chain.rotation @ moved.tool,
        chain.rotation @ exponential(moved.tool_turn),
    )


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

    def joint(self, i: int, revolute: bool) -> tuple[Array, Array]:
        """Velocity (3, n) and angular velocity (3, n) of the tip as joint i moves."""
        if not revolute:
            return self.axes[i], np.zeros_like(self.axes[i])
        return cross(self.axes[i], self.position - self.origins[i]), self.axes[i]

    def joints(self) -> tuple[Array, Array]:
        """The same of all joints, (m, 3, n)."""
        parts = [self.joint(i, turns) for i, turns in enumerate(self.revolute)]
        velocity, angular = zip(*parts, strict=True)
        return np.stack(velocity), np.stack(angular)

    def turns(self) -> tuple[Array, Array]:
        """The same (m, 3, 3, n) as the origins turn about the axes, second, of their own frames."""
        about = np.swapaxes(np.stack(self.turned), 1, 2)
        return np.cross(about, (self.position - self.origins)[:, None], axis=2), about


def move(chain: Links, values: Array, moved: Deviations | None = None) -> Motion:
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
    k = cross_matrix(axis)
    # Rodrigues: exp = 1 + sin(v) K + (1 - cos(v)) K^2 with K^2 = a a' - 1
    cosine, swung = np.cos(angle), 1.0 - np.cos(angle)
    out = np.sin(angle) * _times(rotation, k)
    out += cosine * rotation
    out += (swung * turned(rotation, axis))[:, None] * axis[:, None]
    return out
