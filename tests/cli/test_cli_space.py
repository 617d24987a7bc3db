"""Arms in space on the command line: before a camera, and poses in a tracker's frame."""

import numpy as np
import pinocchio as pin
import pytest
from reference import Truth, read, table
from rendering import Camera

EYE = np.array([0.35, -1.1, 0.55])
LENS = {"focal": 880.0, "k1": -0.09, "shift": (-6.5, 11.5)}
CAMERA = Camera(position=tuple(EYE), target=(0.1, 0.0, 0.2), roll=0.0, **LENS)
ROTATION = ["qx", "qy", "qz", "qw"]
BOUNDS = ["expected_error", "model_error"]


def matrix(found, names):
    """Columns (n, k) of a table."""
    return np.stack([found[name] for name in names], axis=1)


@pytest.fixture(scope="module")
def pictures(run, tmp_path_factory):
    """The truth, a folder, and a model of 45 pictures at 0.3 px."""
    folder, truth = tmp_path_factory.mktemp("pictures"), Truth("spatial_three", 0)
    q = truth.draw(45)
    pixels = CAMERA.project(truth.pose(q)[0]) + truth.rng.normal(0, 0.3, (45, 2))
    table(folder / "log.csv", [*truth.arm.joint_names, *"uv"], np.c_[q, pixels])
    train = f"train spatial_three --data {folder}/log.csv --size 5 -o {folder}/m.calib"
    assert "1280x720" in run.done(train).err
    return truth, folder, q


def test_the_camera_is_where_it_stands(run, pictures):
    _, folder, _ = pictures
    view = run(f"info {folder}/m.calib --json").document["view"]
    assert view["kind"] == "pinhole"
    camera = view["camera"]
    assert np.linalg.norm(np.array(camera["position"]) - EYE) < 3e-3
    turn = pin.Quaternion(np.array(camera["quaternion"])).matrix()  # columns: right, down, ahead
    assert np.degrees(np.linalg.norm(pin.log3(turn @ CAMERA.rotation))) < 0.2
    assert camera["convention"]["joint"] == "shoulder_pan"
    low, high = np.transpose(camera["interval"])
    known = np.array(camera["position_95_up_to_gauge"])
    assert ((known > 0) & (known <= 1.0001 * (high - low) / 2)).all()
    assert view["lens"]["focal"] == pytest.approx(CAMERA.focal, rel=5e-3)
    assert view["focal"]["unit"] == "px"
    words = run(f"info {folder}/m.calib").out
    assert "camera at (" in words
    assert "cannot be told from that joint's offset" in words


def test_pixels_and_the_tip_in_the_base_frame_are_those_of_the_truth(run, pictures):
    truth, folder, _ = pictures
    q = truth.draw(60)
    places, names = truth.pose(q)[0], truth.arm.joint_names
    table(folder / "q.csv", names, q)
    forward = f"query forward {folder}/m.calib --input {folder}/q.csv"
    seen, base = read(run(forward).out), read(run(f"{forward} --in base").out)
    assert np.hypot(*(matrix(seen, "xy") - CAMERA.project(places)).T).mean() < 0.4
    miss = np.linalg.norm(matrix(base, "xyz") - places, axis=1)
    assert miss.mean() < 5e-4
    assert (miss <= base["expected_error"]).mean() >= 0.95
    assert list(base) == [*names, *"xyz", *ROTATION, *BOUNDS]
    one = run("query", "forward", folder / "m.calib", *q[0], "--in", "base", "--json").document
    assert one["unit"] == one["units"]["positions"] == "m"
    assert one["position"] == pytest.approx([base[axis][0] for axis in "xyz"])
    ends = truth.pose(np.array([[-0.3, 0.6, -1.0], [0.4, 0.8, -1.3]]))[0]
    table(folder / "ends.csv", "xyz", ends)
    path = f"query path {folder}/m.calib --input {folder}/ends.csv --in base"
    way = read(run.done(path).out)
    aimed = matrix(way, "xyz")
    np.testing.assert_allclose(aimed[[0, -1]], ends)
    miss = np.linalg.norm(truth.pose(matrix(way, names))[0] - aimed, axis=1)
    assert (miss <= way["expected_error"]).mean() >= 0.95


def test_a_pixel_on_a_plane_gives_a_point_and_joints_that_stand_there(run, pictures):
    truth, folder, _ = pictures
    point = truth.pose([0.3, 0.9, -1.4])[0][0]
    u, v = CAMERA.project(point[None])[0]
    ask = ("query", "inverse", folder / "m.calib")
    found = run(*ask, u, v, "--on", f"z={point[2]}", "--json").document
    assert found["on_plane"]["position"] == pytest.approx(point, abs=1e-3)
    joints = list(found["solutions"][0]["joints"].values())
    assert np.linalg.norm(truth.pose(joints)[0][0] - point) < 1e-3
    up = run(*ask, *CAMERA.centre, "--on", "z=2")  # the plane is above a camera that looks down
    assert (up.code, up.err.count("\n")) == (1, 1)
    assert "in front of the camera" in up.err
    assert run(*ask, u, v, "--on", "x=1").code == 2
    run.refused(3, "does not show the target", *ask, 0.3, -2.0, 0.3, "--in", "base")
    alone = run(*ask, u, v, "--near", "0,0.5,-1", "--keep-orientation")
    assert (alone.code, alone.err.count("\n")) == (1, 1)
    assert "--on z=H" in alone.err


def test_check_and_adapt_follow_a_camera_that_was_moved(run, pictures):
    truth, folder, _ = pictures
    q = truth.draw(30)
    moved = np.array([0.02, 0.03, -0.01])
    pixels = CAMERA.project(truth.pose(q)[0] - moved) + truth.rng.normal(0, 0.3, (30, 2))
    table(folder / "moved.csv", [*truth.arm.joint_names, *"uv"], np.c_[q, pixels])
    assert run(f"check {folder}/m.calib --data {folder}/moved.csv").code == 3
    run.done(f"adapt {folder}/m.calib --data {folder}/moved.csv -o {folder}/a.calib")
    camera = run(f"info {folder}/a.calib --json").document["view"]["camera"]
    assert camera["position"] == pytest.approx(EYE + moved, abs=3e-3)


X, SHIFT = pin.exp3(np.array([-0.4, 0.9, 2.0])), np.array([2.0, -1.0, 0.5])
TOOL = pin.exp3(np.array([0.3, -0.5, 0.8]))
POSTURE = np.array([0.4, -1.0, 1.2, 0.5, 0.8, -0.3])
NEAR = ("--near", ",".join(map(str, POSTURE)))


def quaternions(turns):
    return np.array([pin.Quaternion(turn).coeffs() for turn in turns])


@pytest.fixture(scope="module")
def tracked(run, tmp_path_factory):
    """The truth, a folder, and a model of 60 poses in a tracker's frame."""
    folder, truth = tmp_path_factory.mktemp("tracked"), Truth("six_axis", 1)
    q = truth.draw(60)
    places, turns = seen(truth, q)
    rows = np.c_[q, places + truth.rng.normal(0, 5e-5, places.shape)]
    turns = np.array([pin.exp3(truth.rng.normal(0, 3e-4, 3)) @ turn for turn in turns])
    names = [*truth.arm.joint_names, *"xyz"]
    table(folder / "log.csv", [*names, *ROTATION], np.c_[rows, quaternions(turns)])
    train = f"train six_axis --data {folder}/log.csv --size 4 -o {folder}/m.calib --json"
    return truth, folder, run.done(train).document


def seen(truth, q):
    places, turns = truth.pose(q)
    return places @ X.T + SHIFT, X @ turns @ TOOL


def test_orientations_are_learned_and_answered(run, tracked):
    truth, folder, document = tracked
    assert document["view"]["kind"] == "pose"
    assert document["errors"]["local"]["forward"]["orientation"]["mean"] < 2e-3
    assert "orientation" not in document["errors"]["winner"]["forward"]
    q = truth.draw(40)
    places, turns = seen(truth, q)
    table(folder / "q.csv", truth.arm.joint_names, q)
    found = read(run(f"query forward {folder}/m.calib --input {folder}/q.csv").out)
    cosine = np.abs((matrix(found, ROTATION) * quaternions(turns)).sum(axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(1, cosine))).max() < 0.05
    assert np.linalg.norm(matrix(found, "xyz") - places, axis=1).max() < 2e-4
    assert "orientation" in run(f"evaluate {folder}/m.calib --data {folder}/log.csv -v").out


def test_a_pose_is_answered_by_every_branch(run, tracked):
    truth, folder, _ = tracked
    places, turns = seen(truth, POSTURE)
    quaternion = ",".join(repr(v) for v in quaternions(turns)[0].tolist())
    ask = ("query", "inverse", folder / "m.calib", *places[0], "--quaternion", quaternion)
    found = run(*ask, "--all", "--json").document["solutions"]
    joints = np.array([list(each["joints"].values()) for each in found])
    again, turned = seen(truth, joints)
    assert run(*ask, "--all").out.count("\n\n") + 1 == len(found) >= 4
    assert np.abs(again - places).max() < 3e-4
    assert max(np.linalg.norm(pin.log3(turn.T @ turns[0])) for turn in turned) < 2e-3
    near = run(*ask, *NEAR, "--json").document["solutions"][0]["joints"]
    assert list(near.values()) == pytest.approx(POSTURE, abs=5e-3)
    rpy = ",".join(repr(v) for v in pin.rpy.matrixToRpy(turns[0]).tolist())
    same = run(*ask[:6], "--rpy", rpy, *NEAR, "--json").document["solutions"][0]["joints"]
    assert same == pytest.approx(near, abs=1e-6)


def test_a_table_of_poses_is_answered_row_by_row_in_either_frame(run, tracked):
    truth, folder, _ = tracked
    joints, near = truth.arm.joint_names, [f"near_{name}" for name in truth.arm.joint_names]
    q = POSTURE + truth.rng.uniform(-0.2, 0.2, (4, 6))
    places, turns = seen(truth, q)
    rows = np.c_[q + 0.01, places, quaternions(turns)]
    rows[1, 6:9] += 50.0  # out of reach
    asked = [*near, *"xyz", *ROTATION]
    path = table(folder / "poses.csv", asked, rows)
    path.write_text(path.read_text().replace(f"{rows[3, 6]:.12g}", "none"))
    done = run(f"query inverse {folder}/m.calib --input {path} --output -")
    assert done.code == 1
    assert "row 2 of 4: out of reach" in done.err
    found = read(done.out)
    assert list(found) == [*asked, *joints, "distance", "turned", *BOUNDS, "reachable"]
    assert found["reachable"].tolist() == [1, 0, 1, 0]
    own = matrix(found, joints)[[0, 2]]
    np.testing.assert_allclose(own, q[[0, 2]], atol=5e-3)
    np.testing.assert_allclose(seen(truth, own)[0], rows[[0, 2], 6:9], atol=3e-4)
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


def test_a_tool_turns_less_where_its_orientation_is_to_stay(run, tracked):
    truth, folder, _ = tracked
    target = seen(truth, POSTURE + 0.05)[0][0]
    before = seen(truth, POSTURE)[1][0]
    turned = []
    for more in (["--keep-orientation"], []):
        ask = ("query", "inverse", folder / "m.calib", *target, *NEAR, *more, "--json")
        answer = run(*ask).document["solutions"][0]
        places, turns = seen(truth, np.array([list(answer["joints"].values())]))
        assert np.linalg.norm(places[0] - target) < 3e-4
        turned.append(np.linalg.norm(pin.log3(before.T @ turns[0])))
    assert turned[0] < 0.5 * turned[1]
