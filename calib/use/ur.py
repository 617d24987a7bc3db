"""Universal Robots: a corrected arm as the `kinematics:` entries of their ROS 2 description.

`ur_description/urdf/ur_macro.xacro` places six joints, each turning about its own z axis, one
behind the other from the link `base_link_inertia`.  A URDF of the same arm may have other axes and
other origins along them, so that its `<origin>` elements cannot be copied: frames are laid on the
joints' axes here as that description lays them.
"""

import hashlib
import math

import numpy as np

from ..arm.description import parse_robot
from ..arm.loading import arm_from_urdf
from ..arm.posture import posture_of
from ..arm.rotations import exponential
from ..common.arrays import Array
from ..common.rows import row_lengths
from ..common.wording import listing
from ..errors import OptionError
from ..inverse.closed_form import meeting_point

NAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""The entries of `kinematics:`, from base to tip."""

_QUARTER_TURNS = (0, 1, 1, 1, 2, 1)
"""How many quarter turns about x bring the z axis of `base_link_inertia` to each joint's."""

_MOST_TILTED = math.radians(10.0)
"""An axis further from the description's [rad] is another robot's."""


def ur_kinematics(urdf: str, tip: str) -> str:
    """Return the `kinematics:` entries of a UR's description that place this arm's joints.

    urdf, tip : text of the corrected description, and the frame at the end of the arm
    Raises OptionError if the arm is no UR: other than six turning joints, or axes that at zero
    point elsewhere than a UR's.
    """
    from scipy.spatial.transform import Rotation

    lines = ["kinematics:"]
    before = np.eye(4)
    for name, frame in zip(NAMES, _frames(urdf, tip), strict=True):
        origin = np.linalg.inv(before) @ frame
        before = frame
        angles = Rotation.from_matrix(origin[:3, :3]).as_euler("xyz")
        lines.append(f"  {name}:")
        keys = ("x", "y", "z", "roll", "pitch", "yaw")
        values = [*origin[:3, 3].tolist(), *angles.tolist()]
        for key, value in zip(keys, values, strict=True):
            lines.append(f"    {key}: {value!r}")
    digest = hashlib.sha256("\n".join(lines).encode()).hexdigest()[:20]
    return "\n".join([*lines, f"  hash: calib_{digest}"]) + "\n"


def _frames(urdf: str, tip: str) -> Array:
    """Return the joints' frames (6, 4, 4) at zero, in the frame of `base_link_inertia`.

    Raises OptionError if the arm is no UR.
    """
    robot = parse_robot(urdf)
    joints = [joint for joint in robot.path(tip) if joint.movable]
    if len(joints) != len(NAMES) or not all(joint.revolute for joint in joints):
        raise OptionError(
            f"{len(joints)} joints lead to {tip}: expected the six turning ones of a UR"
        )
    links = posture_of(robot, {}).frames
    # its x points backwards, against that of `base_link`
    base = links.get("base_link", np.eye(4)) @ np.diag([-1.0, -1.0, 1.0, 1.0])
    base = links.get("base_link_inertia", base)
    turn = base[:3, :3]
    names = [joint.name for joint in joints]
    chain = arm_from_urdf(urdf, names, tip).chain
    axes = chain.axes @ turn
    drawn_turns = np.stack(
        [exponential([n * math.pi / 2, 0.0, 0.0]) for n in _QUARTER_TURNS]
    )
    _refuse_other_robots(names, axes, drawn_turns[:, :, 2])
    points = _points((chain.points - base[:3, 3]) @ turn, axes)
    end = (chain.tip - base[:3, 3]) @ turn
    points[5] += (end - points[5]) @ axes[5] * axes[5]
    # about its own axis a frame may be turned as it likes but for the last, which carries the tool
    directions = drawn_turns[:, :, 0]
    hand = turn.T @ links[joints[-1].child][:3, :3]
    directions[-1] = _nearest_column(hand, directions[-1])

    across = directions - (directions * axes).sum(axis=1)[:, None] * axes
    x = across / row_lengths(across)[:, None]
    frames = np.tile(np.eye(4), (len(axes), 1, 1))
    frames[:, :3] = np.stack([x, np.cross(axes, x), axes, points], axis=2)
    return frames


def _refuse_other_robots(names: list[str], axes: Array, drawn: Array) -> None:
    """Refuse joints whose axes (6, 3) at zero point elsewhere than a UR's (6, 3)."""
    cosines = (axes * drawn).sum(axis=1)
    tilted = np.flatnonzero(cosines < math.cos(_MOST_TILTED))
    if len(tilted):
        raise OptionError(
            f"at zero the axes of {listing(names[k] for k in tilted)} do not point where a UR's "
            "do: these entries can describe a UR alone",
            hint="for other arms write a corrected URDF with `calib urdf`",
        )


def _points(points: Array, axes: Array) -> Array:
    """Return the points (6, 3) [m] of the axes at which the description places the joints.

    Shoulder and upper arm where their axes meet, the forearm by the upper arm, each wrist joint
    where the next axis crosses.

    points : (6, 3) [m], any of each axis
    """
    placed = points.copy()
    for k, other in ((1, 0), (0, 1), (2, 1), (3, 4), (4, 5)):
        placed[k] = _nearest(placed[k], axes[k], placed[other], axes[other])
    return placed


def _nearest_column(rotation: Array, direction: Array) -> Array:
    """The column (3,) of a rotation, with its sign, that points most as a direction (3,) does."""
    cosines = rotation.T @ direction
    nearest = np.abs(cosines).argmax()
    return np.asarray(np.sign(cosines[nearest]) * rotation[:, nearest])


def _nearest(
    point: Array, axis: Array, other: Array, direction: Array
) -> Array:
    """Return the point (3,) [m] of an axis that is closest to another axis.

    Of parallel axes it is the one at the height of the other's point.
    """
    nearest = other
    sine = np.linalg.norm(np.cross(axis, direction))
    if sine > math.sin(_MOST_TILTED):
        lines = np.stack([axis, direction]), np.stack([point, other])
        nearest, _ = meeting_point(*lines)
    return point + (nearest - point) @ axis * axis
