"""The corrected arm in the files of others."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.arm.description import parse_robot
from calib.arm.loading import arm_from_urdf
from calib.use.formats import mjcf_text
from calib.use.lerobot import homed
from calib.use.ur import NAMES, ur_kinematics

MOTORS = {
    name: {"id": k, "drive_mode": 0, "homing_offset": 100 * k, "range_min": 800, "range_max": 3200}
    for k, name in enumerate(("shoulder_pan", "elbow_flex", "gripper"), start=1)
}


def degrees(motor, actual):
    """What LeRobot tells of an encoder's ticks."""
    present = actual - motor["homing_offset"]
    return (present - (motor["range_min"] + motor["range_max"]) / 2) * 360 / 4095


def test_a_corrected_calibration_makes_lerobot_tell_the_true_angles(tmp_path):
    (tmp_path / "old.json").write_text(json.dumps(MOTORS))
    offsets = {"shoulder_pan": np.radians(4.0), "elbow_flex": np.radians(-2.5)}
    text, ticks = homed(tmp_path / "old.json", offsets)
    new = json.loads(text)
    assert ticks == {"shoulder_pan": -46, "elbow_flex": 28}
    for name, offset in offsets.items():
        for actual in (900, 2100, 3000):
            told = degrees(new[name], actual) - degrees(MOTORS[name], actual)
            assert told == pytest.approx(np.degrees(offset), abs=0.05)  # half a tick is .044 deg
    assert new["gripper"] == MOTORS["gripper"]


def placed(xyz, rotation):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), xyz
    return out


def test_mujoco_bodies_and_ur_entries_are_where_the_arm_is():
    arm = calib.load_arm("six_axis")
    body = ElementTree.fromstring(mjcf_text(arm.urdf, arm.tip)).find("worldbody")
    pose = np.eye(4)
    q = np.linspace(-0.4, 0.5, arm.dof)
    values = dict(zip(arm.joint_names, q, strict=True))
    while (body := body.find("body")) is not None:
        w, x, y, z = map(float, body.get("quat").split())
        pose = pose @ placed(
            np.array(body.get("pos").split(), float), Rotation.from_quat([x, y, z, w])
        )
        if (joint := body.find("joint")) is not None:
            axis = np.array(joint.get("axis").split(), float)
            pose = pose @ placed(
                np.zeros(3), Rotation.from_rotvec(axis * values[joint.get("name")])
            )
        last = body
    assert last.find("site").get("name") == arm.tip
    assert np.allclose(pose[:3, 3], arm.forward(q), atol=1e-9)
    lines = [line.strip() for line in ur_kinematics(arm.urdf, arm.tip).splitlines()]
    parts = [line for line in lines if line.endswith(":")]
    names = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    assert parts == ["kinematics:", *(f"{name}:" for name in names)]
    first = next(joint for joint in parse_robot(arm.urdf).path(arm.tip) if joint.movable)
    assert f"z: {float(first.xyz[2])!r}" in lines[2:8]


def test_the_command_writes_them(tmp_path, run):
    log, names = tmp_path / "log.csv", calib.load_arm("six_axis").joint_names
    assert run("babble", "six_axis", "-n", "60", "-o", log).code == 0
    model = tmp_path / "arm.calib"
    done = run("train", "six_axis", "--data", log, "--size", "3", "-o", model)
    assert done.code == 0, done.err
    motors = dict.fromkeys(names, MOTORS["elbow_flex"])
    (tmp_path / "old.json").write_text(json.dumps(motors))
    paths = {name: tmp_path / name for name in ("new.json", "ur.yaml", "arm.xml")}
    words = ["-o", paths["new.json"], "--ur", paths["ur.yaml"], "--mjcf", paths["arm.xml"]]
    done = run("export", model, "--lerobot", tmp_path / "old.json", *words, "--json")
    assert done.code == 0, done.err
    assert set(done.document["ticks"].values()) == {0}  # nothing was wrong
    assert all(path.stat().st_size for path in paths.values())
    assert (
        run("export", model, "--lerobot", tmp_path / "old.json", "--ur", paths["ur.yaml"]).code == 2
    )


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
