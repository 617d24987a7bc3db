"""Posture: where Pinocchio puts the joints and links of a robot at given joint values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..errors import RobotError
from .tree import Urdf


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
                axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
                kind = getattr(pin, f"JointModel{motion}Unaligned")(axis)
                carrier = self._model.addJoint(carrier, kind, placed, str(len(self._joints)))
                self._joints[joint.name], placed = carrier, pin.SE3.Identity()
            self._links[joint.child] = carrier, placed

    def posture(self, values: Mapping[str, float]) -> Posture:
        """Return the posture at joint values [rad or m]; joints not named are at zero."""
        data = self._placed(values)
        jacobian = np.reshape(data.J, (6, self._model.nv))  # of one joint it would be a vector
        axes: dict[str, Array] = {}
        points: dict[str, Array] = {}
        for joint in filter(lambda joint: joint.movable, self._urdf.joints):
            number = self._joints[joint.name]
            rows = slice(3, 6) if joint.revolute else slice(0, 3)
            # columns of the world Jacobian are the joints' axes, whatever a URDF says of its frames
            axes[joint.name] = jacobian[rows, number - 1].copy()
            points[joint.name] = np.array(data.oMi[number].translation)
        frames = self.transforms(values)
        return Posture(
            axes,
            points,
            {link: frame[:3, 3].copy() for link, frame in frames.items()},
            {link: frame[:3, :3].copy() for link, frame in frames.items()},
        )

    def transforms(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Transforms (4, 4) of every link in the root's frame at joint values [rad or m]."""
        data = self._placed(values)
        placed = ((link, *self._links[link]) for link in self._urdf.links)
        return {link: (data.oMi[k] * there).homogeneous for link, k, there in placed}

    def _placed(self, values: Mapping[str, float]) -> Any:
        data, q = self._model.createData(), np.zeros(self._model.nq)
        for name, value in values.items():
            q[self._joints[name] - 1] = value  # each joint has one value
        self._pin.computeJointJacobians(self._model, data, q)
        return data
