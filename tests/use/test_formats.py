"""The corrected arm in the files of others."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.arm.description import parse_robot
from calib.samples.tables import write_table
from calib.use.formats import mjcf_text
from calib.use.lerobot import homed
from calib.use.ur import ur_kinematics

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


def test_the_child_of_a_transform_is_the_frame_that_the_log_names(run, tmp_path):
    """It was called `sensor_frame` although the bag said `tracker`."""
    arm = calib.load_arm("spatial_three")
    log = calib.babble(arm, 60, noise=1e-4)
    columns = dict(zip([*arm.joint_names, *"xyz"], np.column_stack([log.q, log.x]).T, strict=True))
    write_table(tmp_path / "log.csv", columns, about={"unit": "m", "frame": "tracker"})
    model, out = tmp_path / "m.calib", tmp_path / "t.json"
    train = ("train", "spatial_three", "--data", tmp_path / "log.csv", "--size", 4, "-o", model)
    assert run(*train).code == 0
    assert run("export", model, "--transform", out).code == 0
    assert json.loads(out.read_text())["child_frame_id"] == "tracker"
