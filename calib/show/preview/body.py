"""Body: where a robot's links are at given joint values, to draw them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arm.ranges import neutral
from ...arm.urdf import parse_urdf
from ...errors import CalibError

if TYPE_CHECKING:
    from ...arm.tree import Joint, Urdf
    from ...model.about import About

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Body:
    """The links of a robot, moved by its active joints.

    Drawing needs no more than this; Pinocchio, which computes what is learned, does not
    have to be installed to look at a model.
    """

    urdf: Urdf  # the checked tree
    text: str  # its own text
    joint_names: tuple[str, ...]  # active joints, base to tip
    tip: str  # the link whose position is sensed
    # [rad or m], where other joints are held; those not named are neutral
    locked: Mapping[str, float]

    @staticmethod
    def of(about: About) -> Body | None:
        """Return the body of a model's robot, None where no URDF came with it."""
        if not about.urdf or not about.tip:
            return None
        try:
            urdf = parse_urdf(about.urdf, about.robot)
        except CalibError:
            return None
        return Body(urdf, about.urdf, about.joint_names, about.tip, about.locked)

    def poses(self, q: ArrayLike) -> dict[str, Array]:
        """Transforms (n, 4, 4) of every link in the root's frame, for joints (n, dof)."""
        rows = np.atleast_2d(np.asarray(q, dtype=float))
        values = self._values(rows)
        poses = {self.urdf.root: np.tile(np.eye(4), (len(rows), 1, 1))}
        waiting = [self.urdf.root]
        while waiting:
            parent = waiting.pop()
            for joint in self.urdf.below(parent):
                poses[joint.child] = poses[parent] @ _moved(joint, values[joint.name])
                waiting.append(joint.child)
        return poses

    def tips(self, q: ArrayLike) -> Array:
        """Position (n, 3) of the tip in the root's frame [m]."""
        return np.asarray(self.poses(q)[self.tip][:, :3, 3])

    def skeleton(self, q: ArrayLike) -> Array:
        """Origins (n, k, 3) of the joints on the way to the tip, and of the tip [m]."""
        poses = self.poses(q)
        return np.stack([poses[link][:, :3, 3] for link in self.way], axis=1)

    @cached_property
    def way(self) -> tuple[str, ...]:
        """Links from the root to the tip."""
        return (self.urdf.root, *(joint.child for joint in self.urdf.path(self.tip)))

    def _values(self, rows: Array) -> dict[str, Array]:
        held: dict[str, Array] = {}
        for joint in self.urdf.joints:
            if joint.name in self.joint_names:
                held[joint.name] = rows[:, self.joint_names.index(joint.name)]
            else:
                value = self.locked.get(joint.name, neutral(joint) if joint.movable else 0.0)
                held[joint.name] = np.full(len(rows), value)
        for joint in self.urdf.joints:
            if joint.mimic and joint.mimic.leader in held and joint.name not in self.locked:
                held[joint.name] = (
                    joint.mimic.multiplier * held[joint.mimic.leader] + joint.mimic.offset
                )
        return held


def transform(xyz: ArrayLike, rpy: ArrayLike) -> Array:
    """Transform (4, 4) of a URDF's origin: roll, pitch and yaw about fixed axes."""
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", np.asarray(rpy, dtype=float)).as_matrix()
    matrix[:3, 3] = xyz
    return matrix


def _moved(joint: Joint, values: Array) -> Array:
    """Transforms (n, 4, 4) from the parent link to the child link."""
    from scipy.spatial.transform import Rotation

    moves = np.tile(np.eye(4), (len(values), 1, 1))
    if joint.movable:
        axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
        if joint.revolute:
            moves[:, :3, :3] = Rotation.from_rotvec(values[:, None] * axis).as_matrix()
        else:
            moves[:, :3, 3] = values[:, None] * axis
    return np.asarray(transform(joint.xyz, joint.rpy) @ moves)
