"""Posture: where Pinocchio puts joints and links, and the chain of few joints that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..errors import RobotError
from .spatial_chain import SpatialChain
from .urdf import Joint, Urdf


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


#: The active joint that a mimic joint follows, its multiplier and its offset [rad or m].
_Following = Mapping[str, tuple[str, float, float]]


def followers(urdf: Urdf, path: Sequence[Joint], active: Sequence[Joint]) -> _Following:
    """Mimic joints on the way to the tip that follow an active joint, directly or through others.

    Returns the active joint, the multiplier and the offset of each.
    """
    names = {joint.name for joint in active}
    found: dict[str, tuple[str, float, float]] = {}
    for joint in path:
        scale, offset, other, seen = 1.0, 0.0, joint, {joint.name}
        while other.mimic and other.name not in names:
            offset += scale * other.mimic.offset
            scale *= other.mimic.multiplier
            leader = urdf.joint(other.mimic.leader)
            if leader is None or leader.name in seen:
                break
            seen.add(leader.name)
            other = leader
        if joint.name not in names and joint.movable and other.name in names:
            found[joint.name] = (other.name, scale, offset)
    return found


def folded(
    moving: Sequence[Joint],
    active: Sequence[Joint],
    following: _Following,
    tip: str,
    posture: Posture,
    urdf: Urdf | None,
) -> SpatialChain:
    """Return the chain of an arm; `posture` has its moving joints at zero.

    `moving` are the active joints and their followers, base to tip; `urdf` states
    the masses that they carry, None where gravity does not matter.
    """
    columns = {joint.name: k for k, joint in enumerate(active)}
    coupling, bias = np.zeros((len(moving), len(active))), np.zeros(len(moving))
    for i, joint in enumerate(moving):
        leader, scale, bias[i] = following.get(joint.name, (joint.name, 1.0, 0.0))
        coupling[i, columns[leader]] = scale
    return SpatialChain(
        np.array([posture.axes[joint.name] for joint in moving]),
        np.array([posture.points[joint.name] for joint in moving]),
        posture.links[tip],
        posture.rotations[tip],
        tuple(joint.revolute for joint in moving),
        coupling,
        bias,
        *(_carried(urdf, posture, moving) if urdf else ()),
    )


def _carried(urdf: Urdf, posture: Posture, joints: Sequence[Joint]) -> tuple[Array, Array]:
    """Lump the masses beyond each joint of a chain, up to the next joint of the chain.

    Links beside the chain (fingers, covers) hang on the last chain joint below them and do not
    move of their own. `posture` has all joints of the chain at zero.

    Returns masses : (m,) [kg]
    Returns centres : (m, 3) [m], in the root frame. Both are empty where the URDF states no mass
        for any of them.
    """
    order = {joint.name: k for k, joint in enumerate(joints)}
    masses, moments = np.zeros(len(joints)), np.zeros((len(joints), 3))
    for link, (mass, centre) in urdf.masses.items():
        below = [order[joint.name] for joint in urdf.path(link) if joint.name in order]
        if below:
            masses[below[-1]] += mass
            place = posture.links[link] + posture.rotations[link] @ np.array(centre)
            moments[below[-1]] += mass * place
    if not masses.any():
        return np.zeros(0), np.zeros((0, 3))
    points = np.array([posture.points[joint.name] for joint in joints])
    safe = np.where(masses > 0, masses, 1.0)[:, None]
    return masses, np.where(masses[:, None] > 0, moments / safe, points)
