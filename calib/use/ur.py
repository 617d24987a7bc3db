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
from ..arm.rigid import rigid
from ..arm.rotations import exponential
from ..common.arrays import Array
from ..common.wording import listing
from ..errors import OptionError

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


def _frames(urdf: str, tip: str) -> list[Array]:
    """Return the joints' frames (4, 4) at zero, in the frame of `base_link_inertia`.

    Along its axis a frame may stand anywhere.  It is put where the description has it: shoulder and
    upper arm where their axes meet, the forearm beside the upper arm, each wrist joint where the
    next axis crosses, and the last at the tip.  The last is turned as the link that it moves.
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
    names = [joint.name for joint in joints]
    chain = arm_from_urdf(urdf, names, tip).chain
    axes = chain.axes @ base[:3, :3]
    points = (chain.points - base[:3, 3]) @ base[:3, :3]
    end = (chain.tip - base[:3, 3]) @ base[:3, :3]
    turns = [
        exponential([count * math.pi / 2, 0.0, 0.0]) for count in _QUARTER_TURNS
    ]
    cosines = [
        axis @ turn[:, 2] for axis, turn in zip(axes, turns, strict=True)
    ]
    tilted = np.flatnonzero(np.array(cosines) < math.cos(_MOST_TILTED))
    if len(tilted):
        raise OptionError(
            f"at zero the axes of {listing(names[k] for k in tilted)} do not point where a UR's "
            "do: these entries can describe a UR alone",
            hint="for other arms write a corrected URDF with `calib urdf`",
        )
    points[1] = _nearest(points[1], axes[1], points[0], axes[0])
    for k, other in ((0, 1), (2, 1), (3, 4), (4, 5)):
        points[k] = _nearest(points[k], axes[k], points[other], axes[other])
    points[5] += (end - points[5]) @ axes[5] * axes[5]
    directions = [turn[:, 0] for turn in turns]
    # about its own axis a frame may be turned as it likes but for the last, which carries the tool
    hand = base[:3, :3].T @ links[joints[-1].child][:3, :3]
    along = hand.T @ directions[-1]
    nearest = np.abs(along).argmax()
    directions[-1] = np.sign(along[nearest]) * hand[:, nearest]
    frames = []
    for axis, point, direction in zip(axes, points, directions, strict=True):
        x = direction - (direction @ axis) * axis
        x = x / np.linalg.norm(x)
        axes_of_frame = np.column_stack([x, np.cross(axis, x), axis])
        frames.append(rigid(axes_of_frame, point))
    return frames


def _nearest(
    point: Array, axis: Array, other: Array, direction: Array
) -> Array:
    """Return the point (3,) [m] of an axis that is closest to another axis.

    Of parallel axes it is the one at the height of the other's point.
    """
    apart = other - point
    cosine = axis @ direction
    along = apart @ axis
    sine_squared = 1.0 - cosine**2
    if sine_squared > math.sin(_MOST_TILTED) ** 2:
        along = (along - cosine * (apart @ direction)) / sine_squared
    return point + along * axis
