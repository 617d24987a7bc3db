"""Universal Robots: a corrected arm as the `kinematics:` entries of their ROS 2 description.

`ur_description/urdf/ur_macro.xacro` places six joints, each turning about its own z axis, one
behind the other from the link `base_link_inertia`.  A URDF of the same arm may have other axes and
other origins along them, so that its `<origin>` elements cannot be copied: frames are laid on the
joints' axes here as that description lays them, and compared with the arm by forward kinematics.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arm.description import parse_robot
from ..arm.posture import posture_of
from ..arm.urdf import Joint, Urdf
from ..common.arrays import Array
from ..common.wording import listed
from ..errors import OptionError

NAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""The entries of `kinematics:`, from base to tip."""

_QUARTER_TURNS = (0, 1, 1, 1, 2, 1)
"""How many quarter turns about x bring the z axis of `base_link_inertia` to each joint's."""

_MOST_TILTED = math.radians(
    10.0
)  # an axis further from the description's is another robot's
_EQUAL = 1e-9  # [m], how closely the entries and the arm have to agree


@dataclass(frozen=True)
class Axis:
    """A joint's axis at zero, in the frame of `base_link_inertia`."""

    point: Array  # (3,) [m]
    direction: Array  # (3,), unit length

    def nearest_to(self, other: Axis) -> Array:
        """Return the point of this axis that is closest to another one, (3,) [m].

        Of parallel axes it is the one at the height of the other's point.
        """
        apart = other.point - self.point
        cosine = float(self.direction @ other.direction)
        sine_squared = 1.0 - cosine**2
        along = float(apart @ self.direction)
        if sine_squared > math.sin(_MOST_TILTED) ** 2:
            along = (
                along - cosine * float(apart @ other.direction)
            ) / sine_squared
        return self.point + along * self.direction


def ur_kinematics(urdf: str, tip: str) -> str:
    """Return the `kinematics:` entries of a UR's description that place this arm's joints.

    urdf, tip : text of the corrected description, and the frame at the end of the arm
    Raises OptionError if the arm is no UR: other than six turning joints, or axes that at zero
    point elsewhere than a UR's.
    """
    parsed = parse_robot(urdf)
    joints = [joint for joint in parsed.path(tip) if joint.movable]
    if len(joints) != len(NAMES) or not all(joint.revolute for joint in joints):
        raise OptionError(
            f"{len(joints)} joints lead to {tip}: expected the six turning ones of a UR"
        )
    base = _base(parsed, joints)
    frames = _frames(
        base, _axes(parsed, joints, base), tip_of(parsed, joints, tip)
    )
    _compare(parsed, joints, tip, base, frames)
    return _text(frames)


def tip_of(urdf: Urdf, joints: Sequence[Joint], tip: str) -> Array:
    """Return where the tip is while all joints are at zero, (3,) [m] in the root link's frame."""
    return _posture(urdf, joints, np.zeros(len(joints)))[tip][:3, 3]


def _posture(urdf: Urdf, joints: Sequence[Joint], q: Array) -> dict[str, Array]:
    """Frames (4, 4) of all links in the root link's."""
    values = {
        joint.name: float(value) for joint, value in zip(joints, q, strict=True)
    }
    return posture_of(urdf, values).frames


def _base(urdf: Urdf, joints: Sequence[Joint]) -> Array:
    """Return the frame (4, 4) of `base_link_inertia`: x points backwards, against `base_link`."""
    frames = _posture(urdf, joints, np.zeros(len(joints)))
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    if "base_link_inertia" in frames:
        return frames["base_link_inertia"]
    return frames.get("base_link", np.eye(4)) @ half_turn


def _axes(urdf: Urdf, joints: Sequence[Joint], base: Array) -> list[Axis]:
    """Return the joints' axes at zero in the frame `base`."""
    frames = _posture(urdf, joints, np.zeros(len(joints)))
    axes = []
    for joint in joints:
        child = np.linalg.inv(base) @ frames[joint.child]
        direction = child[:3, :3] @ np.array(joint.axis)
        axes.append(Axis(child[:3, 3], direction / np.linalg.norm(direction)))
    tilted = [
        joint.name
        for joint, axis, quarters in zip(
            joints, axes, _QUARTER_TURNS, strict=True
        )
        if _quarter_turns(quarters)[:, 2] @ axis.direction
        < math.cos(_MOST_TILTED)
    ]
    if tilted:
        raise OptionError(
            f"at zero the axes of {listed(tilted)} do not point where a UR's do: these entries can "
            "describe a UR alone",
            hint="for other arms write a corrected URDF with `calib urdf`",
        )
    return axes


def _quarter_turns(count: int) -> Array:
    """Return the rotation (3, 3) by so many quarter turns about x."""
    angle = count * math.pi / 2
    cosine = round(math.cos(angle))
    sine = round(math.sin(angle))
    return np.array(
        [[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]]
    )


def _frames(base: Array, axes: Sequence[Axis], tip: Array) -> list[Array]:
    """Return the joints' frames (4, 4) at zero, in the frame `base`.

    Along its axis a frame may stand anywhere.  It is put where the description has it: shoulder and
    upper arm where their axes meet, the forearm beside the upper arm, each wrist joint where the
    next axis crosses, and the last at the tip.

    tip : (3,) [m], in the root link's frame
    """
    shoulder, upper_arm, forearm, *wrist = axes
    end = (np.linalg.inv(base) @ np.append(tip, 1.0))[:3]
    along = float((end - wrist[2].point) @ wrist[2].direction)
    hinge = Axis(upper_arm.nearest_to(shoulder), upper_arm.direction)
    origins = [
        shoulder.nearest_to(upper_arm),
        hinge.point,
        forearm.nearest_to(hinge),
        wrist[0].nearest_to(wrist[1]),
        wrist[1].nearest_to(wrist[2]),
        wrist[2].point + along * wrist[2].direction,
    ]
    frames = []
    for axis, origin, quarters in zip(
        axes, origins, _QUARTER_TURNS, strict=True
    ):
        frame = np.eye(4)
        frame[:3, :3] = _turned_onto(axis.direction, _quarter_turns(quarters))
        frame[:3, 3] = origin
        frames.append(frame)
    return frames


def _turned_onto(z: Array, rotation: Array) -> Array:
    """Return the rotation (3, 3) with this z axis whose x axis is nearest to another's."""
    x = rotation[:, 0] - (rotation[:, 0] @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _compare(
    urdf: Urdf,
    joints: Sequence[Joint],
    tip: str,
    base: Array,
    frames: Sequence[Array],
) -> None:
    """Raise OptionError unless the frames, each turning about z, move the tip as the arm does."""
    start = _posture(urdf, joints, np.zeros(len(joints)))[tip]
    tool = np.linalg.inv(base @ frames[-1]) @ start
    for q in np.random.default_rng(0).uniform(
        -math.pi, math.pi, (5, len(joints))
    ):
        pose = base
        before = np.eye(4)
        for frame, angle in zip(frames, q, strict=True):
            turn = np.eye(4)
            turn[:2, :2] = [
                [math.cos(angle), -math.sin(angle)],
                [math.sin(angle), math.cos(angle)],
            ]
            pose = pose @ np.linalg.inv(before) @ frame @ turn
            before = frame
        arm = _posture(urdf, joints, q)[tip]
        if np.abs(pose @ tool - arm).max() > _EQUAL:
            raise OptionError(
                "the entries would move the tip otherwise than the arm does"
            )


def _text(frames: Sequence[Array]) -> str:
    """Return the YAML document; each entry stands in the frame of the one before."""
    from scipy.spatial.transform import Rotation

    lines = ["kinematics:"]
    before = np.eye(4)
    for name, frame in zip(NAMES, frames, strict=True):
        origin = np.linalg.inv(before) @ frame
        before = frame
        angles = Rotation.from_matrix(origin[:3, :3]).as_euler("xyz")
        lines.append(f"  {name}:")
        keys = ("x", "y", "z", "roll", "pitch", "yaw")
        values = [*origin[:3, 3].tolist(), *angles.tolist()]
        lines += [
            f"    {key}: {value!r}"
            for key, value in zip(keys, values, strict=True)
        ]
    digest = hashlib.sha256("\n".join(lines).encode()).hexdigest()[:20]
    return "\n".join([*lines, f"  hash: calib_{digest}"]) + "\n"
