"""Bags: ROS 1, ROS 2 and MCAP recordings become logs."""

import sys

import numpy as np
import pytest
from conftest import refused
from models import two_link

import calib
from calib.recording.bags import read_bag

rosbags = pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

STEP = 0.02


def q_at(t):
    first = 0.8 + 0.3 * np.sin(t) + 0.2 * np.sin(1.618 * t + 1)  # it does not repeat itself
    return np.stack([first, 1.2 + 0.3 * np.cos(1.3 * t) + 0.1 * np.cos(0.37 * t)], axis=1)


def x_at(t):
    return np.column_stack([two_link(q_at(t)), np.zeros(len(t))])


def turn_at(t):
    """A turn of t [rad] about x, as qx, qy, qz, qw."""
    return float(np.sin(t / 2)), 0.0, 0.0, float(np.cos(t / 2))


def write(path, kind="ros2", tip="PointStamped", n=300, late=0.0, lost=(), stamped=True, every=1):
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    types = {name.rpartition("/")[2]: made for name, made in store.types.items()}
    types["Time"] = store.types["builtin_interfaces/msg/Time"]  # std_msgs has one, too
    joint_t = np.arange(n) * STEP
    tip_t = 0.013 + np.arange(n - 2) * STEP

    def header(t):
        stamp = types["Time"](int(100 + t), int(1e9 * (t % 1))) if stamped else types["Time"](0, 0)
        extra = {"seq": 0} if kind == "ros1" else {}
        return types["Header"](stamp=stamp, frame_id="base" if stamped else "", **extra)

    def joint_state(t, q):
        none = np.zeros(0)
        return types["JointState"](header(t), ["elbow", "shoulder"], q[::-1].copy(), none, none)

    def position(t, x):
        point = types["Point"](*map(float, x))
        turn = types["Quaternion"](*turn_at(t))
        if tip == "TFMessage":
            moved = (("camera", "tag", x), ("base", "link", 2 * x))
            return types["TFMessage"]([transformed(t, *m, turn) for m in moved])
        made = {"PointStamped": point, "PoseStamped": types["Pose"](point, turn)}
        if tip in made:
            return types[tip](header(t), made[tip])
        return transformed(t, "base", "tip", x, turn)

    def transformed(t, parent, child, x, turn):
        transform = types["Transform"](types["Vector3"](*map(float, x)), turn)
        stamped = types["TransformStamped"](header(t), child, transform)
        stamped.header.frame_id = parent
        return stamped

    read = np.arange(n) // every * every
    states = zip(joint_t, q_at(joint_t[read]), strict=True)
    joints = ("/joint_states", "sensor_msgs/msg/JointState")
    messages = [(t, *joints, joint_state(t, q)) for t, q in states]
    kinds, topic = ("tf2_msgs", "/tf") if tip == "TFMessage" else ("geometry_msgs", "/tracker")
    places = x_at(tip_t)
    places[list(lost)] = np.nan
    for t, x in zip(tip_t, places, strict=True):
        messages.append((t, topic, f"{kinds}/msg/{tip}", position(t + late, x)))
    if tip == "TFMessage":
        unturned = types["Quaternion"](*turn_at(0.0))
        still = [transformed(0.0, "tag", "tool", (0.0, 0.0, 0.1), unturned)]
        still += [transformed(0.0, "world", "camera", (1.0, 0.0, 0.0), unturned)]
        messages.append((0.0, "/tf_static", "tf2_msgs/msg/TFMessage", types["TFMessage"](still)))
    rng = np.random.default_rng(0)
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        connections = {}
        for k in rng.permutation(len(messages)):  # out of order
            t, topic, name, message = messages[k]
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            raw = (store.serialize_ros1 if kind == "ros1" else store.serialize_cdr)(message, name)
            writer.write(connections[topic], int(1e9 * (100 + t)), raw)
    return path


BAGS = ["ros1 PointStamped", "ros2 PoseStamped", "mcap TransformStamped", "mcap PointStamped 0"]


@pytest.mark.parametrize("bag", BAGS)
def test_joints_are_interpolated_to_the_positions(tmp_path, bag):
    kind, tip, *unstamped = bag.split()
    stamped = not unstamped  # else the times at which messages came stand for theirs
    path = tmp_path / ("a.bag" if kind == "ros1" else "a")
    bag = write(path, kind, tip, n=100, stamped=stamped)
    found = read_bag(bag, joints=["shoulder", "elbow"])
    assert found.joint_names == ("shoulder", "elbow")
    assert found.source["frame"] == ("base" if stamped else None)
    assert len(found.q) == 98
    assert (np.diff(found.time) > 0).all()
    assert np.abs(found.x - x_at(0.013 + found.time)).max() < 1e-9
    assert np.abs(found.q - q_at(0.013 + found.time)).max() < 2e-4  # linear between 20 ms


def test_joints_published_more_often_than_they_are_read_are_no_stairs(tmp_path):
    """They were up to two messages old: 15 mrad."""
    found = read_bag(write(tmp_path / "a", every=3), time_offset=0.0)
    assert len(found.q) == 297
    assert np.abs(found.q[:, ::-1] - q_at(0.013 + found.time)).max() < 5e-4


@pytest.mark.parametrize("kind", ["mcap", "ros2"])
def test_poses_of_tf_between_two_frames(tmp_path, kind):
    bag = write(tmp_path / "a", kind, "TFMessage", n=100)
    refused(calib.LogError, r"2 transforms or topics move.*base,link.*camera,tag", read_bag, bag)
    found = read_bag(bag, frames=("camera", "tag"))
    assert found.source["frame"] == "camera"
    t = 0.013 + found.time
    assert np.abs(found.x - x_at(t)).max() < 1e-8
    expected = np.array([turn_at(each) for each in t])
    assert np.abs(np.abs((found.orientation * expected).sum(axis=1)) - 1).max() < 1e-12
    refused(calib.LogError, "2 transforms .* expected one", read_bag, bag, frames=("tag", "tool"))


def test_time_offset_undoes_latency(tmp_path):
    path = write(tmp_path / "a", late=0.2)
    wrong, right = (read_bag(path, time_offset=offset) for offset in (0.0, -0.2))
    arm = calib.load_arm("two_link")

    def misfit(found):
        q = found.q[:, [found.joint_names.index(n) for n in arm.joint_names]]
        return np.abs(arm.forward(q) - found.x[:, :2]).max()

    assert misfit(right) < 2e-4 < 0.01 < misfit(wrong)
    found = read_bag(path)
    assert misfit(found) < 1e-3
    assert any("clock is corrected by -0.20" in note for note in found.notes)


def test_lost_positions_and_too_little_motion_for_clocks_are_told(tmp_path):
    found = read_bag(write(tmp_path / "lost", n=100, lost=(0, 7, 8)))
    assert len(found) == 95
    assert "3 positions left out: not finite" in found.notes
    found = read_bag(write(tmp_path / "b", n=60, late=0.1))
    assert "stamps are taken as they are" in found.notes[0]


def test_topics_are_listed(tmp_path):
    refused(calib.LogError, "nofile: no such file or folder", read_bag, "nofile")
    path = write(tmp_path / "a", n=60)
    for words, options in (
        (r"0 topics '/tip' .*/joint_states.*/tracker \(PointStamped\)", {"tip_topic": "/tip"}),
        ("0 topics .*expected one.*JointState", {"tip_topic": "/joint_states"}),
        ("0 joint states of wrist.*its joints: elbow, shoulder", {"joints": ["wrist"]}),
    ):
        refused(calib.LogError, words, read_bag, path, **options)


def test_a_bag_in_a_log_s_place_names_the_command(tmp_path, monkeypatch):
    bag = write(tmp_path / "bag", n=60)
    refused(calib.LogError, "calib log", calib.read_log, bag, joints=["shoulder", "elbow"])
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    refused(calib.LogError, r"pip install 'calib-arm\[ros\]'", read_bag, tmp_path)


def test_the_command_writes_a_log_that_can_be_learned_from(tmp_path, run):
    path, out = write(tmp_path / "a"), tmp_path / "log.csv"
    run.done("log", path, "-o", out)
    samples = calib.read_log(out, joints=["shoulder", "elbow"])
    assert len(samples) == 298
    assert samples.plane is not None
    again = run("log", path, "-o", tmp_path / "b.csv", "--json", "--still", "0.4")
    assert again.document["joints"] == ["elbow", "shoulder"]
    assert 0 < again.document["samples"] < 298
    assert "moved faster than 0.4" in again.err
