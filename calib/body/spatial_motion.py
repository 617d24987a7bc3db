"""Motion of a spatial chain whose joint origins are not quite where a drawing says.

Each joint origin i is moved by a shift d_i and a turn w_i against its nominal place:

    o_i = o_{i-1} + R_{i-1} (t_i + d_i),   E_i = R_{i-1} exp(w_i),   R_i = E_i exp(a_i v_i)

An over-complete parametrisation with a prior on the nominal place needs no convention for nearly
parallel axes (Denavit-Hartenberg does), and slides and turns are treated alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arm.rotations import exponential
from ..arm.spatial_chain import SpatialChain, cross, rotated, times, turned
from ..common.arrays import Array


@dataclass(frozen=True)
class Deviations:
    """How a chain differs from its nominal one."""

    shifts: Array  # (m, 3) [m], of the joint origins, along the axes of the frame before
    turns: Array  # (m, 3) [rad], rotation vectors of the joint origins
    tool: Array  # (3,) [m], of the tip, along the axes of its own frame
    tool_turn: Array  # (3,) [rad]


class Placements(NamedTuple):
    """A chain as links between frames: what Pinocchio and the exported C are made of."""

    strides: Array  # (m, 3) [m], from each joint's origin to the next, in the frame before
    turns: Array  # (m, 3, 3), turn of each joint's origin against the frame before
    tip: Array  # (3,) [m], place of the tip in the last joint's frame
    tip_turn: Array  # (3, 3), its orientation there


def placements(chain: SpatialChain, moved: Deviations | None = None) -> Placements:
    """The links of a chain, of its nominal one where no deviations are given."""
    if moved is None:
        zeros = np.zeros((chain.joints, 3))
        moved = Deviations(zeros, zeros, np.zeros(3), np.zeros(3))
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
    # (m, 3, 3, n), frames of each joint origin before and after its own turn w_i
    before: Array
    after: Array
    axes: Array  # (m, 3, n)
    flange: Array  # (3, 3, n), axes of the tip's frame before its own turn

    def joint(self, i: int, revolute: bool) -> tuple[Array, Array]:
        """Velocity (3, n) and angular velocity (3, n) of the tip as joint i moves."""
        if not revolute:
            return self.axes[i], np.zeros_like(self.axes[i])
        return cross(self.axes[i], self.position - self.origins[i]), self.axes[i]

    def turn(self, i: int, axis: int) -> tuple[Array, Array]:
        """The same as the origin of joint i turns about an axis of its own frame."""
        about = self.after[i][:, axis]
        return cross(about, self.position - self.origins[i]), about


def move(chain: SpatialChain, values: Array, deviations: Deviations) -> Motion:
    """Evaluate a chain at the values (m, n) of its joints [rad or m]."""
    m, n = values.shape
    origins, axes = np.empty((m, 3, n)), np.empty((m, 3, n))
    before, after = np.empty((m, 3, 3, n)), np.empty((m, 3, 3, n))
    rotation = np.repeat(np.eye(3)[:, :, None], n, axis=2)
    position, last = np.zeros((3, n)), np.zeros(3)
    turns = exponential(deviations.turns)
    for i in range(m):
        position = position + turned(rotation, chain.points[i] - last + deviations.shifts[i])
        last = chain.points[i]
        before[i] = rotation
        if deviations.turns[i].any():
            rotation = times(rotation, turns[i])
        after[i], origins[i] = rotation, position
        axes[i] = turned(rotation, chain.axes[i])
        if chain.revolute[i]:
            rotation = rotated(rotation, chain.axes[i], values[i])
        else:
            position = position + axes[i] * values[i]
    flange = times(rotation, chain.rotation)
    position = position + turned(rotation, chain.tip - last) + turned(flange, deviations.tool)
    tip = times(flange, exponential(deviations.tool_turn))
    return Motion(position, tip, origins, before, after, axes, flange)
