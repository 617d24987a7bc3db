"""Exporting: a URDF that describes the arm as it really is."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import RobotError
from .geometry import Geometry

Array = NDArray[np.float64]


def corrected_urdf(geometry: Geometry) -> str:
    """Text of the nominal URDF with corrected joint origins.

    Everything else that yourdfpy knows of (links, meshes, limits, other joints) stays as it
    was.  A joint's offset becomes a turn of its origin about its axis (or a shift along it,
    if it slides), a displacement in the plane a shift of the origin of the joint that it
    moves; the tip's displacement that of the joint which carries the tip.

    Raises
    ------
    RobotError
        If the tip has no joint of its own that could be moved.
    """
    import yourdfpy

    from ..arm.urdf import parse_urdf

    arm = geometry.arm
    urdf = parse_urdf(arm.urdf)
    path = [joint.name for joint in urdf.path(arm.tip)]
    robot = yourdfpy.URDF.load(
        io.BytesIO(arm.urdf.encode()), build_scene_graph=False, load_meshes=False
    )
    joints = {joint.name: joint for joint in robot.robot.joints}
    axes = np.stack([arm.plane.x, arm.plane.y])
    shifts = dict(
        zip(arm.joint_names, np.vstack([geometry.base, geometry.moved[:-1]]), strict=True)
    )
    last = path[-1]
    if last in shifts and joints[last].type != "prismatic":
        raise RobotError(
            f"the tip {arm.tip!r} is the origin of joint {last!r}: it has no place of its own that "
            "could be corrected; name another `tip`"
        )
    shifts[last] = shifts.get(last, np.zeros(2)) + geometry.moved[-1]
    rotation = np.eye(3)
    changes: dict[str, Array] = {}
    for name in path:
        joint = joints[name]
        change = np.eye(4)
        change[:3, 3] = rotation.T @ (shifts.get(name, np.zeros(2)) @ axes)
        changes[name] = change
        rotation = rotation @ _origin(joint)[:3, :3] @ _turn(joint, arm.locked.get(name, 0.0))
    offsets = dict(zip(arm.joint_names, geometry.offsets.tolist(), strict=True))
    for name, change in changes.items():
        joint = joints[name]
        joint.origin = change @ _origin(joint) @ _motion(joint, offsets.get(name, 0.0))
    return _text(robot)


def _origin(joint: Any) -> Array:
    return np.eye(4) if joint.origin is None else np.asarray(joint.origin, dtype=float)


def _motion(joint: Any, value: float) -> Array:
    """Transform of a joint at a value [rad or m]."""
    motion = np.eye(4)
    axis = np.asarray(joint.axis if joint.axis is not None else (1.0, 0.0, 0.0), dtype=float)
    axis = axis / np.linalg.norm(axis)
    if joint.type == "prismatic":
        motion[:3, 3] = value * axis
    elif value:
        k = np.cross(np.eye(3), axis)
        motion[:3, :3] += np.sin(value) * k + (1.0 - np.cos(value)) * k @ k
    return motion


def _turn(joint: Any, value: float) -> Array:
    """Rotation of a joint at a value, none where it is fixed or slides."""
    if joint.type not in ("revolute", "continuous"):
        return np.eye(3)
    return _motion(joint, value)[:3, :3]


def _text(robot: Any) -> str:
    text = robot.write_xml_string()
    return text.decode() if isinstance(text, bytes) else str(text)
