"""Entries for Universal Robots' ROS 2 description."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.arm.loading import arm_from_urdf
from calib.use.ur import NAMES, ur_kinematics

# ur_description/config/ur10/default_kinematics.yaml, in its order: x, y, z [m], roll, pitch, yaw
UR10 = {
    "shoulder": (0.0, 0.0, 0.1273, 0.0, 0.0, 0.0),
    "upper_arm": (0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0),
    "forearm": (-0.612, 0.0, 0.0, 0.0, 0.0, 0.0),
    "wrist_1": (-0.5723, 0.0, 0.163941, 0.0, 0.0, 0.0),
    "wrist_2": (0.0, -0.1157, 0.0, np.pi / 2, 0.0, 0.0),
    "wrist_3": (0.0, 0.0922, 0.0, np.pi / 2, np.pi, np.pi),
}


def entries(text):
    """The numbers of the document: (6,) of each joint."""
    values, joint = {}, ""
    for line in text.splitlines()[1:-1]:
        key, _, value = line.strip().partition(": ")
        if value:
            values[joint].append(float(value))
        else:
            joint = key.rstrip(":")
            values[joint] = []
    return values


def transform(values):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", values[3:]).as_matrix()
    matrix[:3, 3] = values[:3]
    return matrix


def tips(placed, q):
    """Poses of the last frame, as ur_macro.xacro moves it: each joint about its z axis."""
    poses = []
    for row in q:
        pose = np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link_inertia in base_link
        for name, angle in zip(NAMES, row, strict=True):
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
            pose = pose @ transform(placed[name]) @ turn
        poses.append(pose)
    return np.array(poses)


def example(name):
    pinocchio = pytest.importorskip("pinocchio")
    folder = (
        Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots/ur_description/urdf"
    )
    if not folder.is_dir():
        pytest.skip("example-robot-data is not installed")
    return (folder / name).read_text()


def test_a_drawing_with_other_axes_becomes_the_description_s_own_entries():
    """The joints of this URDF turn about y: its origins, copied, put the arm metres away."""
    placed = entries(ur_kinematics(example("ur10_robot.urdf"), "tool0"))
    for name, values in UR10.items():
        assert np.allclose(transform(placed[name]), transform(values), atol=1e-9), name


def test_a_corrected_arm_moves_as_its_entries_do():
    """With joint origins that are shifted and turned by what a calibration finds."""
    numbers = iter(range(100))

    def moved(origin):
        k = next(numbers)
        xyz = np.array(origin[1].split(), float) + 1e-3 * np.sin([k, k + 1, k + 2])
        rpy = np.array(origin[2].split(), float) + 1e-3 * np.cos([k, 3 * k, 5 * k])
        place = (" ".join(map(repr, values.tolist())) for values in (xyz, rpy))
        return '<origin xyz="{}" rpy="{}"/>'.format(*place)

    links, joints = calib.load_arm("six_axis").urdf.split('<joint name="shoulder_pan"')
    joints = re.sub(r'<origin xyz="(.+?)" rpy="(.+?)"/>', moved, joints)
    text = links + '<joint name="shoulder_pan"' + joints
    arm = arm_from_urdf(text)
    placed = entries(ur_kinematics(arm.urdf, arm.tip))
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 6))
    position, rotation = arm.pose(q)
    tool = None
    for pose, x, quaternion in zip(tips(placed, q), position, rotation, strict=True):
        tip = transform([*x, *Rotation.from_quat(quaternion).as_euler("xyz")])
        if tool is None:
            tool = np.linalg.inv(pose) @ tip
        assert np.allclose(pose @ tool, tip, atol=1e-9)
