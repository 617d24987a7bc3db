"""The corrected arm in files and figures of others: LeRobot, MuJoCo, UR, ISO 9283, ROS 2."""

import ast
import json
import sys
from types import ModuleType, SimpleNamespace
from unittest.mock import Mock
from xml.etree import ElementTree

import numpy as np
import pytest
from boards import motion
from models import bare
from reference import ROBOTS, needs_robots
from scipy.spatial.transform import Rotation

import calib

DEGREES = {"shoulder_pan": 4.0, "elbow": -2.5}
MOTOR = {"drive_mode": 0, "homing_offset": 100, "range_min": 800, "range_max": 3200}
# ur_description/config/ur10/default_kinematics.yaml, in its order: x, y, z [m], roll, pitch, yaw
UR10 = {
    "shoulder": (0.0, 0.0, 0.1273, 0.0, 0.0, 0.0),
    "upper_arm": (0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0),
    "forearm": (-0.612, 0.0, 0.0, 0.0, 0.0, 0.0),
    "wrist_1": (-0.5723, 0.0, 0.163941, 0.0, 0.0, 0.0),
    "wrist_2": (0.0, -0.1157, 0.0, np.pi / 2, 0.0, 0.0),
    "wrist_3": (0.0, 0.0922, 0.0, np.pi / 2, np.pi, np.pi),
}


def exported(run, folder, robot, changes=()):
    """What `calib export` writes of an arm after changes, and the arm as it is then."""
    made = calib.babble(calib.load_arm(robot), 100, changes=list(changes))
    model = folder / "arm.calib"
    calib.train(made, size=3).save(model)
    (folder / "old.json").write_text(json.dumps(dict.fromkeys(made.joint_names, MOTOR)))
    words = f"--lerobot {folder}/old.json --ur {folder}/ur.yaml --mjcf {folder}/arm.xml"
    done = run.done(f"export {model} {words} -o {folder}/new.json --json")
    run.done(f"urdf {model} -o {folder}/new.urdf")
    return done.document, calib.load_arm(folder / "new.urdf")


@pytest.fixture(scope="module")
def corrected(run, tmp_path_factory):
    """The files of a six-joint arm two of whose joints stand elsewhere."""
    folder = tmp_path_factory.mktemp("corrected")
    changes = [f"{name}.offset={np.radians(value):.12g}" for name, value in DEGREES.items()]
    return folder, *exported(run, folder, "six_axis", changes)


def zero(motor):
    """The encoder's tick of which LeRobot tells 0; 4095 of them are a turn."""
    return motor["homing_offset"] + (motor["range_min"] + motor["range_max"]) / 2


def test_a_corrected_calibration_makes_lerobot_tell_the_true_angles(corrected):
    folder, document, _ = corrected
    motors = json.loads((folder / "new.json").read_text())
    assert document["ticks"]["elbow"] == 28
    for name, motor in motors.items():
        told = (zero(MOTOR) - zero(motor)) * 360 / 4095
        assert told == pytest.approx(DEGREES.get(name, 0.0), abs=0.05)  # half a tick


def test_a_zero_beyond_the_motors_register_is_refused(corrected, run):
    folder, _, arm = corrected
    motors = dict.fromkeys(arm.joint_names, MOTOR | {"homing_offset": 2030})
    (folder / "far.json").write_text(json.dumps(motors))
    line = f"export {folder}/arm.calib --lerobot {folder}/far.json -o {folder}/none.json"
    run.refused(1, "on a tooth further", line)
    assert not (folder / "none.json").exists()


def about(axis, angle):
    return motion(Rotation.from_rotvec(np.array(axis, float) * angle), np.zeros(3))


def test_mujoco_bodies_are_where_the_arm_is(corrected):
    folder, _, arm = corrected
    body = ElementTree.parse(folder / "arm.xml").getroot().find("worldbody")
    pose, q = np.eye(4), np.linspace(-0.4, 0.5, arm.dof)
    values = dict(zip(arm.joint_names, q, strict=True))
    while (body := body.find("body")) is not None:
        w, x, y, z = map(float, body.get("quat").split())
        pose = pose @ motion(Rotation.from_quat([x, y, z, w]), body.get("pos").split())
        if (joint := body.find("joint")) is not None:
            pose = pose @ about(joint.get("axis").split(), values[joint.get("name")])
        last = body
    assert last.find("site").get("name") == arm.tip
    assert np.allclose(pose[:3, 3], arm.forward(q), atol=1e-7)


def entries(text):
    """Transforms of the joints that a document of Universal Robots' description holds."""
    values, joint = {}, ""
    for line in text.splitlines()[1:-1]:
        key, _, value = line.strip().partition(":")
        if value:
            values[joint].append(float(value))
        else:
            joint = key
            values[joint] = []
    return {name: of_entry(row) for name, row in values.items()}


def of_entry(row):
    return motion(Rotation.from_euler("xyz", row[3:]), row[:3])


def test_entries_of_universal_robots_move_as_the_corrected_arm_does(corrected):
    """As ur_macro.xacro moves them: each joint about its z axis."""
    folder, _, arm = corrected
    placed = entries((folder / "ur.yaml").read_text())
    assert list(placed) == list(UR10)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 6))
    tools = []
    for row, x, quaternion in zip(q, *arm.pose(q), strict=True):
        pose = np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link_inertia in base_link
        for name, angle in zip(UR10, row, strict=True):
            pose = pose @ placed[name] @ about([0.0, 0.0, 1.0], angle)
        tools.append(np.linalg.inv(pose) @ motion(Rotation.from_quat(quaternion), x))
    assert np.allclose(tools, tools[0], atol=1e-6)
    # the tool's frame is the last joint's: it is turned by the zeros of the joints before
    assert np.allclose(tools[0][:3, :3], np.round(tools[0][:3, :3]), atol=1e-6)


@needs_robots
def test_a_drawing_with_other_axes_becomes_the_description_s_own_entries(run, tmp_path):
    """The joints of this URDF turn about y: its origins, copied, put the arm metres away."""
    exported(run, tmp_path, ROBOTS / "ur_description/urdf/ur10_robot.urdf")
    placed = entries((tmp_path / "ur.yaml").read_text())
    for name, values in UR10.items():
        assert np.allclose(placed[name], of_entry(values), atol=1e-6), name


OFFSET = 0.01  # of the elbow [rad]


class Message(SimpleNamespace):
    """A ROS message of any type: fields appear when they are first used."""

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        field = Message()
        setattr(self, name, field)
        return field


class Node:
    """What a node uses of rclpy."""

    def __init__(self, name):
        self.name, self.sent, self.logged = name, {}, []

    def declare_parameter(self, name, value):
        return SimpleNamespace(value=value)

    def get_logger(self):
        log = self.logged.append
        return SimpleNamespace(info=log, warning=log, error=log)

    def create_publisher(self, kind, topic, depth):
        self.sent[topic] = []
        return SimpleNamespace(publish=self.sent[topic].append)

    create_subscription = create_timer = get_clock = Mock()


class Status(Message):
    OK, WARN, ERROR, STALE = range(4)


@pytest.fixture(scope="module")
def package(tmp_path_factory, run):
    """The package of a model whose elbow stands 10 mrad off."""
    log = bare("two_link", 150, 1, f"elbow.offset={OFFSET}", noise=2e-5)
    folder = tmp_path_factory.mktemp("ros") / "arm_calib"
    calib.train(log, size=4, view="base").save(folder.parent / "m.calib")
    run.done("export", folder.parent / "m.calib", "--ros2", folder)
    return folder


@pytest.fixture
def corrector(package, monkeypatch):
    """The package's node, with ROS's modules replaced."""
    sender = SimpleNamespace(sendTransform=lambda _: None)
    modules = {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "ament_index_python.packages": {"get_package_share_directory": lambda name: package},
        "diagnostic_msgs.msg": {"DiagnosticArray": Message, "DiagnosticStatus": Status},
        "geometry_msgs.msg": {"PointStamped": Message, "TransformStamped": Message},
        "sensor_msgs.msg": {"JointState": Message},
        "tf2_ros": {"StaticTransformBroadcaster": lambda node: sender},
        "trajectory_msgs.msg": {"JointTrajectory": Message},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    scope = {"__name__": "node"}
    exec((package / "arm_calib" / "node.py").read_text(), scope)  # the project's own template
    return scope["Corrector"]()


def trajectory(q):
    points = [SimpleNamespace(positions=[0.5, *row[::-1]]) for row in q]
    return Message(joint_names=["gripper", "elbow", "shoulder"], points=points)


def test_every_point_of_a_trajectory_is_corrected(corrector):
    """A snippet of the docs sent each point to the first one's place."""
    q = np.linspace([0.4, 0.8], [1.0, 1.6], 6)
    corrector.correct(trajectory(q))
    (message,) = corrector.sent["~/corrected"]
    sent = np.array([point.positions for point in message.points])
    assert (sent[:, 0] == 0.5).all()  # joints that the model does not know pass through
    assert np.allclose(sent[:, 1], q[:, 1] - OFFSET, atol=2e-4)
    assert np.allclose(sent[:, 2], q[:, 0], atol=2e-4)


def test_a_trajectory_that_cannot_be_corrected_is_not_sent_in_part(corrector):
    """Its last point lies beyond the joints' ranges, or its values are of other joints."""
    q = np.array([[0.4, 0.8], [1.5, 0.2618]])  # the elbow would go beyond its limit
    corrector.correct(trajectory(q))
    corrector.correct(Message(joint_names=["elbow"], points=[]))
    assert corrector.sent["~/corrected"] == []
    assert "points [1] of 2" in corrector.logged[-2]
    assert "lacks the joints ['shoulder']" in corrector.logged[-1]


@pytest.mark.parametrize(("moved", "level"), [(0.0, Status.OK), (0.05, Status.ERROR)])
def test_rows_of_the_last_minutes_tell_of_drift(corrector, moved, level):
    arm = calib.load_arm("two_link")
    rng = np.random.default_rng(2)
    for second, q in enumerate(rng.uniform([0.1, 0.4], [1.4, 2.4], (40, 2))):
        joints = Message(name=["elbow", "shoulder"], position=q[::-1], velocity=[0.0, 0.0])
        corrector.remember_joints(joints)
        x = arm.forward(q + np.array([0.0, OFFSET + moved])) + rng.normal(0.0, 2e-5, 2)
        header = Message(stamp=Message(sec=second, nanosec=0))
        corrector.remember_row(Message(header=header, point=Message(x=x[0], y=x[1], z=0.0)))
    corrector.check()
    (message,) = corrector.sent["/diagnostics"]
    assert message.status[0].level == level


def test_the_package_is_whole_and_other_folders_are_left_alone(package, tmp_path, run):
    root = ElementTree.parse(package / "package.xml").getroot()
    assert root.findtext("name") == "arm_calib"
    launch = ast.parse((package / "launch" / "arm_calib.launch.py").read_text())
    functions = [part.name for part in launch.body if isinstance(part, ast.FunctionDef)]
    assert functions == ["generate_launch_description"]
    assert "arm_calib.node:main" in (package / "setup.py").read_text()
    assert "$base/lib/arm_calib" in (package / "setup.cfg").read_text()
    assert isinstance(json.loads((package / "transforms.json").read_text()), list)
    offsets = ElementTree.parse(package / "offsets.xacro").getroot()
    values = {entry.get("name"): float(entry.get("value")) for entry in offsets}
    assert values["elbow_offset"] == pytest.approx(OFFSET, abs=3e-4)
    assert calib.load(package / "arm.calib").about.robot == "two_link"
    # other folders are left alone
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "text.txt").write_text("mine")
    export = ("export", package / "arm.calib", "--ros2")
    run.refused(1, "name of a ROS package", *export, tmp_path / "My-Package")
    run.refused(1, "holds other files", *export, tmp_path / "notes")
    assert [path.name for path in (tmp_path / "notes").iterdir()] == ["text.txt"]
