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
    """A Pinocchio model of a checked URDF, asked for postures."""

    def __init__(self, urdf: Urdf) -> None:
        pin = _import_pinocchio()
        numbered = urdf.numbered()
        try:
            self._model: Any = pin.buildModelFromXML(numbered.plain())
        except Exception as error:  # Pinocchio raises what its parser happened to throw
            raise RobotError(
                f"Pinocchio cannot read the robot {urdf.name!r} ({error}): check its joints"
            ) from None
        self._pin = pin
        self._urdf = urdf
        joints = zip(urdf.joints, numbered.joints, strict=True)
        self._joints = {joint.name: self._model.getJointId(own.name) for joint, own in joints}
        links = zip(urdf.links, numbered.links, strict=True)
        body = pin.FrameType.BODY
        self._frames = {link: self._model.getFrameId(own, body) for link, own in links}

    def posture(self, values: Mapping[str, float]) -> Posture:
        """Return the posture at joint values [rad or m]; joints not named are at zero."""
        model, data = self._model, self._placed(values)
        jacobian = np.reshape(data.J, (6, model.nv))  # of one joint it would be a vector
        axes: dict[str, Array] = {}
        points: dict[str, Array] = {}
        for joint in self._urdf.joints:
            if not joint.movable:
                continue
            number = self._joints[joint.name]
            column = model.joints[number].idx_v
            rows = slice(3, 6) if joint.revolute else slice(0, 3)
            axes[joint.name] = jacobian[rows, column].copy()
            points[joint.name] = np.array(data.oMi[number].translation)
        frames = {link: data.oMf[frame] for link, frame in self._frames.items()}
        links = {link: np.array(frame.translation) for link, frame in frames.items()}
        rotations = {link: np.array(frame.rotation) for link, frame in frames.items()}
        return Posture(axes, points, links, rotations)

    def transforms(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Transforms (4, 4) of every link in the root's frame at joint values [rad or m]."""
        data = self._placed(values)
        return {link: data.oMf[frame].homogeneous for link, frame in self._frames.items()}

    def _placed(self, values: Mapping[str, float]) -> Any:
        """Pinocchio's data at joint values."""
        pin, model = self._pin, self._model
        data, q = model.createData(), np.zeros(model.nq)
        for name, value in values.items():
            q[model.joints[self._joints[name]].idx_q] = value
        # columns of the world Jacobian are the joints' axes, whatever a URDF says of its frames
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        return data


def _import_pinocchio() -> Any:
    try:
        import pinocchio
    except ImportError as error:
        raise RobotError(
            f"robots need Pinocchio, which cannot be imported ({error}): pip install pin"
        ) from None
    return pinocchio
