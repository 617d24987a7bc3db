"""Arms in space on the command line: before a camera, and poses in a tracker's frame."""

import numpy as np
import pytest
from conftest import lengths
from reference import random_joints, read, table
from rendering import Camera
from scipy.spatial.transform import Rotation

import calib

THREE = calib.load_arm("spatial_three")
OFFSET = np.radians([0.0, 2.0, -3.0])  # which its log does not know
EYE = np.array([0.35, -1.1, 0.55])
LENS = {"focal": 880.0, "k1": -0.09, "shift": (-6.5, 11.5)}
CAMERA = Camera(position=tuple(EYE), target=(0.1, 0.0, 0.2), roll=0.0, **LENS)
ROTATION = ["qx", "qy", "qz", "qw"]
BOUNDS = ["expected_error", "model_error"]
SIX = calib.load_arm("six_axis")
FRAME, SHIFT = Rotation.from_rotvec([-0.4, 0.9, 2.0]), np.array([2.0, -1.0, 0.5])
TOOL = Rotation.from_rotvec([0.3, -0.5, 0.8])
POSTURE = np.array([0.4, -1.0, 1.2, 0.5, 0.8, -0.3])
NEAR = ("--near", ",".join(map(str, POSTURE)))


def matrix(found, names):
    """Columns (n, k) of a table."""
    return np.stack([found[name] for name in names], axis=1)


def tips(q):
    """True tips (n, 3) [m] at what the encoders read."""
    return THREE.pose(np.atleast_2d(q) + OFFSET)[0]


def write_pictures(path, n, seed, moved=0.0):
    """Write a log of n pictures at 0.3 px, by a camera that has moved [m]."""
    q = random_joints(THREE, n, seed)
    pixels = CAMERA.project(tips(q) - moved) + np.random.default_rng(seed).normal(0, 0.3, (n, 2))
    table(path, [*THREE.joint_names, *"uv"], np.c_[q, pixels])


@pytest.fixture(scope="module")
def folder(run, tmp_path_factory):
    """A folder with a model of 45 pictures."""
    folder = tmp_path_factory.mktemp("pictures")
    write_pictures(folder / "log.csv", 45, 0)
    train = f"train spatial_three --data {folder}/log.csv --size 5 -o {folder}/m.calib"
    assert "1280x720" in run.done(train).err
    return folder


def test_the_camera_is_where_it_stands(run, folder):
    view = run(f"info {folder}/m.calib --json").document["view"]
    assert view["kind"] == "pinhole"
    camera = view["camera"]
    assert np.linalg.norm(np.array(camera["position"]) - EYE) < 3e-3
    # columns: right, down, ahead
    turn = Rotation.from_quat(camera["quaternion"]) * Rotation.from_matrix(CAMERA.rotation)
    assert np.degrees(turn.magnitude()) < 0.2
    assert camera["convention"]["joint"] == "shoulder_pan"
    low, high = np.transpose(camera["interval"])
    known = np.array(camera["position_95_up_to_gauge"])
    assert ((known > 0) & (known <= 1.0001 * (high - low) / 2)).all()
    assert view["lens"]["focal"] == pytest.approx(CAMERA.focal, rel=5e-3)
    assert view["focal"]["unit"] == "px"
    words = run(f"info {folder}/m.calib").out
    assert "camera at (" in words
    assert "cannot be told from that joint's offset" in words


def test_pixels_and_the_tip_in_the_base_frame_are_those_of_the_truth(run, folder):
    q = random_joints(THREE, 60, 1)
    places, names = tips(q), THREE.joint_names
    table(folder / "q.csv", names, q)
    forward = f"query forward {folder}/m.calib --input {folder}/q.csv"
    seen, base = read(run(forward).out), read(run(f"{forward} --in base").out)
    assert np.hypot(*(matrix(seen, "xy") - CAMERA.project(places)).T).mean() < 0.4
    miss = lengths(matrix(base, "xyz") - places)
    assert miss.mean() < 5e-4
    assert (miss <= base["expected_error"]).mean() >= 0.95
    assert list(base) == [*names, *"xyz", *ROTATION, *BOUNDS]
    done = run("query", "forward", folder / "m.calib", *q[0], "--in", "base", "--json")
    assert "leaves out the base frame's turn" in done.err
    one = done.document
    assert one["unit"] == one["units"]["positions"] == "m"
    assert one["position"] == pytest.approx([base[axis][0] for axis in "xyz"])
    ends = tips([[-0.3, 0.6, -1.0], [0.4, 0.8, -1.3]])
    table(folder / "ends.csv", "xyz", ends)
    way = read(run.done(f"query path {folder}/m.calib --input {folder}/ends.csv --in base").out)
    np.testing.assert_allclose(matrix(way, "xyz")[[0, -1]], ends)
    miss = lengths(tips(matrix(way, names)) - matrix(way, "xyz"))
    assert (miss <= way["expected_error"]).mean() >= 0.95


def test_a_pixel_on_a_plane_gives_a_point_and_joints_that_stand_there(run, folder):
    point = tips([0.3, 0.9, -1.4])[0]
    u, v = CAMERA.project(point)
    ask = ("query", "inverse", folder / "m.calib")
    found = run(*ask, u, v, "--on", f"z={point[2]}", "--json").document
    assert found["on_plane"]["position"] == pytest.approx(point, abs=1e-3)
    joints = list(found["solutions"][0]["joints"].values())
    assert np.linalg.norm(tips(joints) - point) < 1e-3
    # the plane is above a camera that looks down
    up = run.refused(1, "in front of the camera", *ask, *CAMERA.centre, "--on", "z=2")
    assert up.err.count("\n") == 1
    assert run(*ask, u, v, "--on", "x=1").code == 2
    run.refused(3, "does not show the target", *ask, 0.3, -2.0, 0.3, "--in", "base")
    run.refused(1, "--on z=H", *ask, u, v, "--near", "0,0.5,-1", "--keep-orientation")


def test_a_pixel_is_of_the_camera_that_is_named(run, folder, tmp_path):
    """The first one's was taken: half a metre off."""
    east = Camera(position=(1.0, 0.5, 0.6), target=(0.1, 0.0, 0.2), roll=0.0, **LENS)
    q, names = random_joints(THREE, 45, 4), THREE.joint_names
    seen_by_east = east.project(tips(q)) + np.random.default_rng(4).normal(0, 0.3, (45, 2))
    table(tmp_path / "tracker.csv", [*names, *"xyz"], np.c_[q, tips(q) + 0.5])
    table(tmp_path / "east.csv", [*names, *"uv"], np.c_[q, seen_by_east])
    files = f"--data {tmp_path}/tracker.csv --data {folder}/log.csv --data {tmp_path}/east.csv"
    run.done(f"train spatial_three {files} --size 3 -o {tmp_path}/m.calib")
    point = tips([0.3, 0.9, -1.4])[0]
    for name, camera in (("log", CAMERA), ("east", east)):
        ask = ("query", "inverse", tmp_path / "m.calib", *camera.project(point), "--on")
        found = run.done(*ask, f"z={point[2]}", "--in", name, "--json").document
        assert found["on_plane"]["position"] == pytest.approx(point, abs=1e-3)
        assert found["frame"] == "base"
    for frame in ([], ["--in", "base"], ["--in", "tracker"]):
        run.refused(2, "tracker is no camera: expected --in log or east", *ask, "z=0.1", *frame)


def test_check_and_adapt_follow_a_camera_that_was_moved(run, folder):
    moved = np.array([0.02, 0.03, -0.01])
    write_pictures(folder / "moved.csv", 30, 2, moved)
    assert run(f"check {folder}/m.calib --data {folder}/moved.csv").code == 3
    run.done(f"adapt {folder}/m.calib --data {folder}/moved.csv -o {folder}/a.calib")
    camera = run(f"info {folder}/a.calib --json").document["view"]["camera"]
    assert camera["position"] == pytest.approx(EYE + moved, abs=3e-3)


def seen(q):
    """Positions and orientations of a probe in a tracker's frame."""
    places, turns = SIX.pose(np.atleast_2d(q))
    return FRAME.apply(places) + SHIFT, FRAME * Rotation.from_quat(turns) * TOOL


@pytest.fixture(scope="module")
def tracked(run, tmp_path_factory):
    """A folder, and what was printed of a model of 60 poses in it."""
    folder, rng = tmp_path_factory.mktemp("tracked"), np.random.default_rng(1)
    q = random_joints(SIX, 60)
    places, turns = seen(q)
    turns = Rotation.from_rotvec(rng.normal(0, 3e-4, (60, 3))) * turns
    rows = np.c_[q, places + rng.normal(0, 5e-5, (60, 3)), turns.as_quat()]
    table(folder / "log.csv", [*SIX.joint_names, *"xyz", *ROTATION], rows)
    train = f"train six_axis --data {folder}/log.csv --size 4 -o {folder}/m.calib --json"
    return folder, run.done(train).document


def test_orientations_are_learned_and_answered(run, tracked):
    folder, document = tracked
    assert document["view"]["kind"] == "pose"
    assert document["errors"]["local"]["forward"]["orientation"]["mean"] < 2e-3
    assert "orientation" not in document["errors"]["winner"]["forward"]
    q = random_joints(SIX, 40, 1)
    places, turns = seen(q)
    table(folder / "q.csv", SIX.joint_names, q)
    found = read(run(f"query forward {folder}/m.calib --input {folder}/q.csv").out)
    off = turns.inv() * Rotation.from_quat(matrix(found, ROTATION))
    assert np.degrees(off.magnitude().max()) < 0.05
    assert lengths(matrix(found, "xyz") - places).max() < 2e-4
    assert "orientation" in run(f"evaluate {folder}/m.calib --data {folder}/log.csv -v").out


def joints_of(solution):
    return list(solution["joints"].values())


def test_a_pose_is_answered_by_every_branch_and_a_place_with_little_turn(run, tracked):
    folder, _ = tracked
    places, turns = seen(POSTURE)
    ask = ("query", "inverse", folder / "m.calib", *places[0])
    quaternion = ("--quaternion", ",".join(map(repr, turns.as_quat()[0].tolist())))
    found = run(*ask, *quaternion, "--all", "--json").document["solutions"]
    again, turned = seen([joints_of(each) for each in found])
    assert run(*ask, *quaternion, "--all").out.count("\n\n") + 1 == len(found) >= 4
    assert np.abs(again - places).max() < 3e-4
    assert (turns.inv() * turned).magnitude().max() < 2e-3
    near = run(*ask, *quaternion, *NEAR, "--json").document["solutions"][0]
    assert joints_of(near) == pytest.approx(POSTURE, abs=5e-3)
    rpy = ",".join(map(repr, turns.as_euler("xyz")[0].tolist()))
    same = run(*ask, "--rpy", rpy, *NEAR, "--json").document["solutions"][0]
    assert joints_of(same) == pytest.approx(joints_of(near), abs=1e-6)
    # a tool turns less where its orientation is to stay
    target, before = seen(POSTURE + 0.05)[0][0], seen(POSTURE)[1]
    turned = []
    for more in (["--keep-orientation"], []):
        ask = ("query", "inverse", folder / "m.calib", *target, *NEAR, *more, "--json")
        places, turns = seen(joints_of(run(*ask).document["solutions"][0]))
        assert np.linalg.norm(places[0] - target) < 3e-4
        turned.append((before.inv() * turns).magnitude()[0])
    assert turned[0] < 0.5 * turned[1]


def test_a_table_of_poses_is_answered_row_by_row_in_either_frame(run, tracked):
    folder, _ = tracked
    joints, near = SIX.joint_names, [f"near_{name}" for name in SIX.joint_names]
    q = POSTURE + np.random.default_rng(2).uniform(-0.2, 0.2, (4, 6))
    places, turns = seen(q)
    rows = np.c_[q + 0.01, places, turns.as_quat()]
    rows[1, 6:9] += 50.0  # out of reach
    asked = [*near, *"xyz", *ROTATION]
    path = table(folder / "poses.csv", asked, rows)
    path.write_text(path.read_text().replace(f"{rows[3, 6]:.12g}", "none"))
    line = f"query inverse {folder}/m.calib --input {path} --output -"
    found = read(run.refused(1, "row 2 of 4: out of reach", line).out)
    assert list(found) == [*asked, *joints, "distance", "turned", *BOUNDS, "reachable"]
    assert found["reachable"].tolist() == [1, 0, 1, 0]
    own = matrix(found, joints)[[0, 2]]
    np.testing.assert_allclose(own, q[[0, 2]], atol=5e-3)
    np.testing.assert_allclose(seen(own)[0], rows[[0, 2], 6:9], atol=3e-4)
    # the base frame knows nothing of the probe's mounting: ask for what `forward` answers
    table(folder / "q.csv", joints, q[:2])
    ask = f"{folder}/m.calib --input {folder}"
    run.done(f"query forward {ask}/q.csv --output {folder}/base.csv --in base")
    told = run(f"query inverse {ask}/base.csv --in base --all --json").document
    assert (told["rows"], told["unit"]) == (2, "m")
    for k in range(2):
        mine = matrix(told["answers"], joints)[np.equal(told["answers"]["row"], k + 1)]
        assert len(mine) >= 4
        assert np.abs(mine - q[k]).max(axis=1).min() < 1e-6
    assert max(told["answers"]["distance"]) < 1e-9
    assert run(f"query inverse {ask}/q.csv --all").code != 0
