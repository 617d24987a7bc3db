"""Posture: where Pinocchio puts the joints and links of a robot at given joint values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..errors import RobotError
from .tree import Joint, Urdf


@dataclass(frozen=True, eq=False)
class Posture:
    """Axes and positions at one posture, in the root link's frame."""

    axes: dict[str, Array]  # (3,), unit axis of each movable joint
    points: dict[str, Array]  # (3,) [m], origin of each movable joint's frame
    links: dict[str, Array]  # (3,) [m], origin of each link's frame
    rotations: dict[str, Array]  # (3, 3), orientation of each link's frame


class Kinematics:
    """A Pinocchio model of a checked URDF, asked for postures.

    It is built joint by joint: a stranger's names may mean something to Pinocchio's own parser,
    which calls the world `universe`, and gaps that do no harm here stop it.
    """

    def __init__(self, urdf: Urdf) -> None:
        try:
            import pinocchio as pin
        except ImportError as error:
            raise RobotError(
                f"robots need Pinocchio, which cannot be imported ({error}): pip install pin"
            ) from None
        self._pin: Any = pin
        self._urdf, self._model = urdf, pin.Model()
        self._joints: dict[str, int] = {}
        # of each link the joint that carries it, and its placement there
        self._links: dict[str, tuple[int, Any]] = {urdf.root: (0, pin.SE3.Identity())}
        # a URDF may list a joint before the one that carries it
        for joint in sorted(urdf.joints, key=lambda joint: len(urdf.path(joint.child))):
            carrier, there = self._links[joint.parent]
            placed = there * pin.SE3(pin.rpy.rpyToMatrix(*joint.rpy), np.array(joint.xyz))
            if joint.movable:
                motion = "Revolute" if joint.revolute else "Prismatic"
                kind = getattr(pin, f"JointModel{motion}Unaligned")(_direction(joint))
                carrier = self._model.addJoint(carrier, kind, placed, str(len(self._joints)))
                self._joints[joint.name], placed = carrier, pin.SE3.Identity()
            self._links[joint.child] = carrier, placed

    def posture(self, values: Mapping[str, float]) -> Posture:
        """Return the posture at joint values [rad or m]; joints not named are at zero."""
        frames = self.transforms(values)
        # a movable joint's frame is that of its child, in which its axis is at rest
        movable = [(joint, frames[joint.child]) for joint in self._urdf.joints if joint.movable]
        return Posture(
            {joint.name: frame[:3, :3] @ _direction(joint) for joint, frame in movable},
            {joint.name: frame[:3, 3] for joint, frame in movable},
            {link: frame[:3, 3] for link, frame in frames.items()},
            {link: frame[:3, :3] for link, frame in frames.items()},
        )

    def transforms(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Transforms (4, 4) of every link in the root's frame at joint values [rad or m]."""
        data, q = self._model.createData(), np.zeros(self._model.nq)
        for name, value in values.items():
            q[self._joints[name] - 1] = value  # each joint has one value
        self._pin.forwardKinematics(self._model, data, q)
        return {link: (data.oMi[k] * there).homogeneous for link, (k, there) in self._links.items()}


def _direction(joint: Joint) -> Array:
    """Unit axis (3,) of a joint in its own frame."""
    axis = np.array(joint.axis)
    return np.asarray(axis / np.linalg.norm(axis))
