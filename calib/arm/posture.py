"""Posture: where the joints and links of a robot are at given joint values.

Pinocchio would say the same; its import alone takes a tenth of a training of a planar arm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .rotations import exponential
from .tree import Joint, Urdf


@dataclass(frozen=True, eq=False)
class Posture:
    """Axes and positions at one posture, in the root link's frame."""

    axes: dict[str, Array]  # (3,), unit axis of each movable joint
    points: dict[str, Array]  # (3,) [m], origin of each movable joint's frame
    links: dict[str, Array]  # (3,) [m], origin of each link's frame
    rotations: dict[str, Array]  # (3, 3), orientation of each link's frame


class Kinematics:
    """A checked URDF, asked for postures."""

    def __init__(self, urdf: Urdf) -> None:
        self._urdf = urdf
        self._joints = sorted(urdf.joints, key=lambda joint: len(urdf.path(joint.child)))
        self._origins = {joint.name: _origin(joint) for joint in self._joints}

    def posture(self, values: Mapping[str, float]) -> Posture:
        """Return the posture at joint values [rad or m]; joints not named are at zero."""
        frames = self.transforms(values)
        movable = [joint for joint in self._urdf.joints if joint.movable]
        return Posture(
            # a joint's own motion leaves its axis where it is
            {j.name: frames[j.child][:3, :3] @ _unit(j) for j in movable},
            {j.name: frames[j.child][:3, 3].copy() for j in movable},
            {link: frame[:3, 3].copy() for link, frame in frames.items()},
            {link: frame[:3, :3].copy() for link, frame in frames.items()},
        )

    def transforms(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Transforms (4, 4) of every link in the root's frame at joint values [rad or m]."""
        frames = {self._urdf.root: np.eye(4)}
        for joint in self._joints:
            frame = frames[joint.parent] @ self._origins[joint.name]
            if joint.movable and joint.name in values:
                moved = _unit(joint) * values[joint.name]
                if joint.revolute:
                    frame[:3, :3] = frame[:3, :3] @ exponential(moved)
                else:
                    frame[:3, 3] += frame[:3, :3] @ moved
            frames[joint.child] = frame
        return {link: frames[link] for link in self._urdf.links}


def _unit(joint: Joint) -> Array:
    axis = np.array(joint.axis)
    return np.asarray(axis / np.linalg.norm(axis))


def _origin(joint: Joint) -> Array:
    """Transform (4, 4) from the parent link to the joint; roll, pitch, yaw about fixed axes."""
    frame = np.eye(4)
    roll, pitch, yaw = exponential(np.diag(joint.rpy))
    frame[:3, :3] = yaw @ pitch @ roll
    frame[:3, 3] = joint.xyz
    return frame
