"""The ROS 2 package that a model writes, run against stand-ins for ROS's modules."""

import ast
import json
import sys
from types import ModuleType, SimpleNamespace
from unittest.mock import Mock
from xml.etree import ElementTree

import numpy as np
import pytest
from models import bare

import calib

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
