"""Arms in space before a camera, on the command line, against a projection of its own."""

import json

import numpy as np
import pinocchio as pin
import pytest
from reference import Truth, read, table

EYE, FOCAL, CENTRE, K1 = np.array([0.35, -1.1, 0.55]), 880.0, np.array([633.0, 371.0]), -0.09
MOVED = np.array([0.02, 0.03, -0.01])


def looking(at):
    """Axes of a camera at EYE that looks at a point: rows right, down, ahead."""
    z = (at - EYE) / np.linalg.norm(at - EYE)
    x = np.cross(z, (0, 0, 1.0))
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


CAMERA = looking(np.array([0.1, 0.0, 0.2]))


def project(places):
    point = (places - EYE) @ CAMERA.T
    n = point[:, :2] / point[:, 2:]
    return FOCAL * n * (1 + K1 * (n**2).sum(axis=1, keepdims=True)) + CENTRE


@pytest.fixture(scope="module")
def pictures(run, tmp_path_factory):
    """The truth, a folder, and a model of 45 pictures at 0.3 px."""
    folder, truth = tmp_path_factory.mktemp("pictures"), Truth("spatial_three", 0)
    q = truth.draw(45)
    pixels = project(truth.pose(q)[0]) + truth.rng.normal(0, 0.3, (45, 2))
    names = [*truth.arm.joint_names, "u", "v"]
    table(folder / "log.csv", names, np.c_[q, pixels])
    table(folder / "mirrored.csv", names, np.c_[q, 1280 - pixels[:, :1], pixels[:, 1:]])
    done = run("train", "spatial_three", "--data", folder / "log.csv", "--size", 5, "-o",
               folder / "m.calib")  # fmt: skip
    assert done.code == 0, done.err
    assert "1280x720" in done.err
    return truth, folder, q


def test_the_camera_is_where_it_stands(run, pictures):
    _, folder, _ = pictures
    view = run("info", folder / "m.calib", "--json").document["view"]
    assert view["kind"] == "pinhole"
    camera = view["camera"]
    assert np.linalg.norm(np.array(camera["position"]) - EYE) < 3e-3
    turn = pin.Quaternion(np.array(camera["quaternion"])).matrix()  # columns: right, down, ahead
    assert np.degrees(np.linalg.norm(pin.log3(turn @ CAMERA))) < 0.2
    assert camera["convention"]["joint"] == "shoulder_pan"
    low, high = np.transpose(camera["interval"])
    known = np.array(camera["position_95_up_to_gauge"])
    assert ((known > 0) & (known <= 1.0001 * (high - low) / 2)).all()
    assert view["lens"]["focal"] == pytest.approx(FOCAL, rel=5e-3)
    assert view["focal"]["unit"] == "px"
    words = run("info", folder / "m.calib").out
    assert "camera at (" in words
    assert "cannot be told from that joint's offset" in words


def test_pixels_and_the_tip_in_the_base_frame_are_those_of_the_truth(run, pictures):
    truth, folder, _ = pictures
    q = truth.draw(60)
    places, names = truth.pose(q)[0], truth.arm.joint_names
    table(folder / "q.csv", names, q)
    forward = ("query", "forward", folder / "m.calib", "--input", folder / "q.csv")
    seen, base = read(run(*forward).out), read(run(*forward, "--in", "base").out)
    assert np.hypot(*(np.c_[seen["x"], seen["y"]] - project(places)).T).mean() < 0.4
    miss = np.linalg.norm(np.c_[base["x"], base["y"], base["z"]] - places, axis=1)
    assert miss.mean() < 5e-4
    assert (miss <= base["expected_error"]).mean() >= 0.95
    answers = ["x", "y", "z", "qx", "qy", "qz", "qw", "expected_error", "model_error"]
    assert list(base) == [*names, *answers]
    one = run("query", "forward", folder / "m.calib", *q[0], "--in", "base", "--json").document
    assert one["unit"] == one["units"]["positions"] == "m"
    assert one["position"] == pytest.approx([base[axis][0] for axis in "xyz"])


def test_a_pixel_on_a_plane_gives_a_point_and_joints_that_stand_there(run, pictures):
    truth, folder, _ = pictures
    point = truth.pose([0.3, 0.9, -1.4])[0][0]
    u, v = project(point[None])[0]
    ask = ("query", "inverse", folder / "m.calib")
    found = run(*ask, u, v, "--on", f"z={point[2]}", "--json").document
    assert found["on_plane"]["position"] == pytest.approx(point, abs=1e-3)
    joints = list(found["solutions"][0]["joints"].values())
    assert np.linalg.norm(truth.pose(joints)[0][0] - point) < 1e-3
    up = run(*ask, *CENTRE, "--on", "z=2")  # the plane is above a camera that looks down
    assert (up.code, up.err.count("\n")) == (1, 1)
    assert "in front of the camera" in up.err
    assert run(*ask, u, v, "--on", "x=1").code == 2
    behind = run(*ask, 0.3, -2.0, 0.3, "--in", "base")
    assert behind.code == 3
    assert "does not show the target" in behind.err
    alone = run(*ask, u, v, "--near", "0,0.5,-1", "--keep-orientation")
    assert (alone.code, alone.err.count("\n")) == (1, 1)
    assert "--on z=H" in alone.err


def test_the_camera_goes_to_ros(run, pictures):
    _, folder, _ = pictures
    files = {"--camera": folder / "camera.yaml", "--transform": folder / "camera.json"}
    done = run("export", folder / "m.calib", *(part for pair in files.items() for part in pair))
    assert done.code == 0, done.err
    info = json.loads(files["--camera"].read_text())
    assert (info["image_width"], info["distortion_model"]) == (1280, "plumb_bob")
    place = json.loads(files["--transform"].read_text())
    assert place["header"]["frame_id"] == "base"
    assert list(place["transform"]["translation"].values()) == pytest.approx(EYE, abs=3e-3)
    assert run("export", folder / "m.calib").code == 2


def test_check_and_adapt_follow_a_camera_that_was_moved(run, pictures):
    truth, folder, _ = pictures
    q = truth.draw(30)
    pixels = project(truth.pose(q)[0] - MOVED) + truth.rng.normal(0, 0.3, (30, 2))
    path = table(folder / "moved.csv", [*truth.arm.joint_names, "u", "v"], np.c_[q, pixels])
    assert run("check", folder / "m.calib", "--data", path).code == 3
    assert run("adapt", folder / "m.calib", "--data", path, "-o", folder / "a.calib").code == 0
    camera = run("info", folder / "a.calib", "--json").document["view"]["camera"]
    assert camera["position"] == pytest.approx(EYE + MOVED, abs=3e-3)
