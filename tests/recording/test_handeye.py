"""Hand-eye: from rendered pictures of a board to where camera and board are."""

import json
import os
import re
from dataclasses import replace
from functools import cache
from threading import Thread

import cv2
import numpy as np
import polars
import pytest
from boards import SIZE, SPEC, Rig
from conftest import refused
from reference import table
from rendering import Camera, Desk, board
from test_lerobot import REST, write_dataset

import calib
from calib import LogError, handeye
from calib.arm.rotations import exponential, logarithm, matrix_of
from calib.recording.board import parse_board
from calib.recording.motion_tables import JointTable, read_joints

FLIP = np.diag([1.0, -1.0, -1.0])  # OpenCV's frame of a board has y down
CORNER = np.array([0.084, 0.06, 0.0])  # the middle of the board in OpenCV's frame


@cache
def shots(in_hand, pictures=10, seed=0):
    """A rig, its pictures and its joints; the board lies on the desk in its own frame."""
    rig = Rig(in_hand, seed=seed, pictures=pictures)
    z = rig.structure.predict(rig.q, rig.beta)
    rng = np.random.default_rng(seed)
    made = board(7, 5, 0.024, 0.018, (0.0, 0.0, 0.0, 0.0))
    taken = []
    for row in z:
        turn, shift = exponential(row[None, 3:])[0], row[:3]
        if in_hand:  # the camera's pose in the board's frame
            turn, shift = turn.T, -turn.T @ shift
        # the board's frame, y down, is turned about x into the desk's, z up
        world = turn @ FLIP
        position = -world.T @ (shift + turn @ CORNER)
        f, u, v, k1 = rig.lens
        placed = {"position": tuple(position), "shift": (u - 639.5, v - 359.5), "turned": world}
        desk = Desk(Camera(focal=f, k1=k1, **placed), still=(made,), noise=2.0, blur=0.6)
        taken.append(desk.picture([0.0] * 3, rng, arm=False))
    return rig, taken, JointTable("joints", rig.arm.joint_names, rig.q, None, None)


@pytest.fixture(autouse=True, scope="module")
def _found_once():
    """Search each picture for its board once."""
    corners, kind = {}, type(parse_board(SPEC))
    search = kind.find

    def find(board, grey):
        key = board, grey.tobytes()
        if key not in corners:
            corners[key] = search(board, grey)
        return dict(corners[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kind, "find", find)
        yield


@cache
def solved(in_hand):
    rig, pictures, joints = shots(in_hand)
    return handeye(rig.arm, pictures, joints, SPEC, rig.eye)


@pytest.mark.parametrize("in_hand", [True, False])
def test_camera_and_board_are_found_from_pictures(in_hand):
    rig, found = shots(in_hand)[0], solved(in_hand)
    off, share = rig.miss(found)
    assert np.linalg.norm(off) < 1e-3
    assert (share < 1.5).all()
    turned = matrix_of(np.array(found.hand["quaternion"])[None])[0]
    away = logarithm((turned.T @ rig.hand(rig.beta)[1])[None])
    assert np.linalg.norm(away) < np.radians(0.15)
    assert found.used == found.pictures == 10
    assert found.reprojection["mean"] < 0.3
    assert found.to_json()["eye"] == rig.eye
    assert abs(found.lens["focal"] - rig.lens[0]) < 2.0 + found.lens["focal_95"]


def test_what_pictures_without_the_board_show_is_told():
    rig, pictures, joints = shots(True)
    few, some = pictures[:6], replace(joints, q=joints.q[:6])
    flipped = [np.ascontiguousarray(picture[:, ::-1]) for picture in few]
    refused(LogError, "mirrored", handeye, rig.arm, flipped, some, SPEC, "hand")
    refused(LogError, "7x5", handeye, rig.arm, few, some, "5x7:24mm:18mm:5x5_100", "hand")


def test_a_wrong_reading_is_named():
    rig = Rig(True, seed=1, pictures=12)
    for words, q in (
        ("columns are exchanged", rig.q[:, [0, 2, 1, 3, 4, 5]]),
        ("wrist_2 counts the other way", rig.q * (1, 1, 1, 1, -1, 1)),
        ("the joint values are degrees", np.degrees(rig.q)),
        ("wrist_1 alone is in degrees", rig.q * (1, 1, 1, np.degrees(1), 1, 1)),
        ("a row late", np.roll(rig.q, 1, axis=0)),
    ):
        refused(LogError, words, rig.solve, q=q)
    late = np.degrees(np.roll(rig.q, 1, axis=0))
    refused(LogError, "the joint values are degrees", rig.solve, q=late)
    # in two ways at once, which no reading explains: "degrees" was the nearest
    rig = Rig(True, seed=8, pictures=12)
    wrong = rig.q[:, [0, 2, 1, 3, 4, 5]] * (1, 1, 1, 1, -1, 1)
    refused(LogError, "no place of camera and board", rig.solve, q=wrong)


def test_a_camera_is_known_across_its_line_of_sight():
    """Shift and turn of what stands still err together: with their sign .8 mm was told."""
    rig = Rig(True, seed=1, pictures=20)
    body = rig.solve().body
    poses, slopes = body.structure.linearise(rig.q, body.beta)
    across = np.cross(poses[:, :3], (0.3, 0.5, 0.8))
    across /= np.linalg.norm(across, axis=1)[:, None]
    away = poses - rig.structure.predict(rig.q, rig.beta)
    moves = np.einsum("ni,nik->nk", across, slopes[:, :3][..., body.active] @ body.root)
    told = np.median(np.linalg.norm(moves, axis=1))
    assert np.median(np.abs((across * away[:, :3]).sum(axis=1))) < told < 5e-4


@pytest.mark.parametrize("in_hand", [True, False])
def test_a_wrong_board_is_measured_and_a_wrong_eye_named(in_hand):
    rig = Rig(in_hand, seed=1, pictures=12)
    found = rig.solve(board="7x5:23.5mm:18mm:5x5_100")
    low, high = found.square["interval"]
    assert low < 24e-3 < high < 24.3e-3
    assert any("squares measure 24" in note for note in found.notes)
    assert (rig.miss(found)[1] < 1.0).all()
    words = "squares measure 24 mm, 36 mm as said"
    refused(LogError, words, rig.solve, board="7x5:36mm:18mm:5x5_100")
    refused(LogError, "up to wrist_1", rig.solve, arm=calib.load_arm("six_axis", tip="wrist_1"))
    refused(LogError, f"eye='{rig.eye}'", rig.solve, eye="base" if in_hand else "hand")


@pytest.mark.parametrize(("seed", "pictures", "play"), [(6, 24, 0.12), (4, 8, 0.3), (18, 8, 0.3)])
def test_no_picture_is_left_out_by_an_arm_that_repeats_badly_which_is_told(seed, pictures, play):
    """Two of eight were left out, and a camera was 13.5 mm off with 9 claimed."""
    rig = Rig(True, seed=seed, pictures=pictures)
    true, rng = rig.q, np.random.default_rng(seed)
    rig.look(true + np.radians(play) * rng.normal(0.0, 1.0, true.shape), rng)
    found = rig.solve(q=true)
    assert found.used == pictures
    assert "the arm repeats to" in " ".join(found.notes)
    assert 0.5 < found.repeatability["rotation"] / np.radians(play) < 2.0
    off, share = rig.miss(found)
    assert np.linalg.norm(off) < 4e-3
    assert (share < 1.5).all()


def test_the_drawing_of_another_robot_is_told(tmp_path):
    """Its fourth link is 25 mm longer: no drawing is off by as much."""
    rig = Rig(True, seed=5, pictures=24)
    joint, other = f'<joint name="{rig.arm.joint_names[4]}"', tmp_path / "other.urdf"
    head, tail = rig.arm.urdf.split(joint)
    xyz = re.search(r'xyz="([^"]*)"', tail)[1]
    x, y, z = map(float, xyz.split())
    other.write_text(head + joint + tail.replace(xyz, f"{x} {y + 0.025} {z}", 1))
    found = rig.solve(arm=other)
    assert any("drawing of another robot" in note for note in found.notes)
    assert (rig.miss(found)[1] < 1.5).all()
    assert max(found.hand["position_95"]) > 5e-3  # along the last axis nothing tells


def test_a_lens_that_is_off_is_told_and_one_of_another_size_refused():
    rig = Rig(True, seed=6, pictures=20)
    found = rig.solve(lens=replace(rig.glass, focal=1.01 * rig.glass.focal))
    assert any("the lens that was given" in note for note in found.notes)
    assert abs(found.lens["focal"] - rig.lens[0]) < 2.0
    assert (rig.miss(found)[1] < 1.5).all()
    refused(LogError, "640x480", rig.solve, lens=replace(rig.glass, size=(640, 480)))


@pytest.mark.parametrize("seed", [0, 4, 6])
def test_a_lens_that_is_off_is_told_by_few_pictures(seed):
    """Noise of the corners grew in its place: 20 px off, to 0.0 px."""
    rig = Rig(True, seed=seed, pictures=6, noise=0.4)
    found = rig.solve(lens=replace(rig.glass, focal=1.02 * rig.glass.focal))
    assert abs(found.lens["focal"] - rig.lens[0]) < found.lens["focal_95"]


MOVED = "from 13.png on camera or board was moved, the camera refocused"
ON_THE_WAY = [  # what changes by how much, a seed, pictures, the first after it, what is told
    ("view.shift", 0.05, 2, 20, 13, MOVED),
    ("tool", 0.05, 2, 20, 13, MOVED),
    ("lens", 60.0, 2, 20, 13, MOVED),
    ("view.shift", 0.02, 3, 5, 4, "camera or board was moved (which 5 poses may not show"),
]


@pytest.mark.parametrize(("group", "step", "seed", "pictures", "first", "words"), ON_THE_WAY)
def test_what_changed_on_the_way_is_told(group, step, seed, pictures, first, words):
    rig = Rig(True, seed=seed, pictures=pictures)
    moved = rig.as_seen(rig.changed(**{group: (0, step)})) - rig.as_seen(rig.beta)
    found = rig.solve(seen=rig.seen + (rig.rows >= first)[:, None] * moved)
    assert found.used == (first if pictures == 20 else pictures)
    assert words in " ".join(found.notes)


def test_a_lens_that_was_fitted_anew_is_no_change(run, tmp_path):
    """The model's own pictures were called drifted: their poses stood 4 mm elsewhere."""
    rig = Rig(True, known=False, pictures=40)
    calib.train(rig.solve().poses, size=4).save(tmp_path / "rig.calib")
    for drifted in (False, True):
        if drifted:  # the camera in its mount, by half a degree
            turn = rig.structure.groups["tool.rotation"]
            more = exponential(np.radians([[0.0, 0.5, 0.0]]))[0]
            rig.beta[turn] = logarithm(exponential(rig.beta[turn]) @ more)
            rig.look(rig.q, np.random.default_rng(1))
        log = rig.shots().log(rig.shots().lens(), "hand")
        calib.write_log(log, tmp_path / "log.csv")
        done = run("check", tmp_path / "rig.calib", "--data", tmp_path / "log.csv", "--json")
        assert done.document["drifted"] is drifted
        assert "computed with the model's lens" in done.err


def test_joints_may_be_a_pipe_of_json_for_several_cameras(monkeypatch, tmp_path):
    rig = Rig(True, seed=1, pictures=8)
    seen = [dict(enumerate(picture)) for picture in rig.seen.reshape(8, -1, 2)]
    find = "calib.recording.board.CharucoPattern.find"
    monkeypatch.setattr(find, lambda _, grey: seen[grey[0, 0]])
    blank = [np.full(SIZE[::-1], number, np.uint8) for number in range(8)]
    records = [{"q": [*q], "picture": f"{k}.png"} for k, q in enumerate(rig.q)]
    for name, rows in (("records.json", records), ("rows.json", rig.q.tolist())):
        (tmp_path / name).write_text(json.dumps(rows))
        assert read_joints(tmp_path / name, rig.arm.joint_names).q.tolist() == rig.q.tolist()
    np.save(tmp_path / "q.npy", rig.q)
    assert read_joints(tmp_path / "q.npy", rig.arm.joint_names).q.tolist() == rig.q.tolist()
    os.mkfifo(tmp_path / "pipe")
    Thread(target=(tmp_path / "pipe").write_text, args=(json.dumps(rows),), daemon=True).start()
    pictures = {"a": blank, "b": blank}
    found = handeye(rig.arm, pictures, tmp_path / "pipe", SPEC, "hand", lens=rig.glass)
    assert [camera["name"] for camera in found.cameras] == ["a", "b"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Rendered pictures, and their joints beside them."""
    _, pictures, joints = shots(True)
    made = tmp_path_factory.mktemp("rig")
    (made / "shots").mkdir()
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(made / "shots" / f"{k:02d}.png"), picture)
    table(made / "joints.csv", joints.names, joints.q)
    return made


def test_the_command_says_where_the_camera_is_and_its_model_watches_it(folder, run):
    rig = shots(True)[0]
    transform, model = folder / "rig.json", folder / "rig.calib"
    seen = [folder / "shots", "--joints-file", folder / "joints.csv"]
    words = ["six_axis", *seen, "--board", SPEC, "--eye", "hand"]
    done = run.done("handeye", *words, "--transform", transform, "-o", model, "--json")
    position, _ = rig.hand(rig.beta)
    assert np.allclose(done.document["hand"]["position"], position, atol=1e-3)
    told = json.loads(transform.read_text())
    assert [each["child_frame_id"] for each in told] == ["camera_frame", "board_frame"]
    # the model alone tells the same
    files = ["--transform", folder / "again.json", "--camera", folder / "camera.yaml"]
    run.done("export", model, *files)
    for pair in zip(told, json.loads((folder / "again.json").read_text()), strict=True):
        assert pair[0]["header"] == pair[1]["header"]
        places = [[*each["transform"]["translation"].values()] for each in pair]
        assert np.allclose(*places, atol=1e-3)
    assert json.loads((folder / "camera.yaml").read_text())["image_width"] == 1280
    # the same pictures
    done = run("check", model, "--data", *seen, "--json")
    assert done.code in (0, 3), done.err  # ten pictures are few
    assert not done.document["drifted"]
    run.refused(2, "--joints-file", "check", model, "--data", folder / "shots")


watching = cache(lambda: calib.train(solved(True).poses, size=4))
TILT = {"tool.rotation": (0, 0.006)}
ALIKE = [
    (TILT, {"tool": 0.344}),
    ({"offset": (-1, 0.02)}, {"offset:wrist_3": 1.146}),
    ({"offset": (2, 0.01), **TILT}, {"offset:elbow": 0.573, "tool": 0.344}),
]  # changes [rad], and what is told of them [deg]


@pytest.mark.parametrize(("changes", "sizes"), ALIKE)
def test_a_turned_camera_and_an_offset_of_the_last_joint_are_not_told_twice(changes, sizes):
    rig = Rig(True, pictures=40)
    log = rig.shots(seen=rig.as_seen(rig.changed(**changes))).log(rig.glass, "hand")
    adapted = calib.adapt(watching(), log.take(slice(20, 40)))
    told = {cause.cause: np.degrees(cause.value) for cause in adapted.changed}
    assert told == pytest.approx(sizes, rel=0.05)
    assert adapted.improved
    assert not calib.check(adapted.model, log.take(slice(20))).drifted


def test_a_log_of_board_pictures_is_learned_from_like_any_other(folder, run):
    log, model = folder / "poses.csv", folder / "poses.calib"
    words = ["--joints-file", folder / "joints.csv", "--board", SPEC, "--eye", "hand"]
    done = run.done("log", folder / "shots", *words, "-o", log, "--json")
    assert done.document["samples"] == 10
    assert done.document["point"][:2] == [0.0, 0.0]  # ahead of the camera
    # each pose has its covariance, in the sensor's axes
    columns = polars.read_csv(log, comment_prefix="#").columns
    assert sum(name.startswith("cov_") for name in columns) == 21
    done = run.done("train", "six_axis", "--data", log, "--size", "8", "-o", model, "--json")
    assert done.document["errors"]["local"]["forward"]["distance"]["mean"] < 2e-3
    for command in ("check", "adapt", "evaluate"):
        done = run(command, model, "--data", log, "--json")
        assert done.code == 0 or (done.code == 3 and command != "evaluate"), done.err
    assert calib.load(model).about.options["board"]["eye"] == "hand"


def test_a_dataset_of_lerobot_is_read_as_pictures_and_joints(tmp_path, run):
    rig, pictures, joints = shots(True)
    q = np.degrees(np.repeat(joints.q, REST, axis=0))
    q[:, 2] -= 3.0  # the horn of the elbow's servo sits three degrees off
    written = {"codec": "mpeg4", "pictures": pictures, "names": joints.names}
    write_dataset(tmp_path, "v3.0", q, **written)
    log = tmp_path / "poses.csv"
    done = run.done("log", tmp_path, "--board", SPEC, "--eye", "hand", "-o", log)
    assert "degrees" in done.err
    made = polars.read_csv(log, comment_prefix="#")
    assert made.columns[:6] == list(joints.names)
    assert made["episode"].to_list() == [0] * 5 + [1] * 5
    assert np.allclose(made[:, :6].to_numpy(), np.radians(q[::REST]))
    motor = {"homing_offset": 7, "range_min": 0, "range_max": 4095}
    (tmp_path / "calibration.json").write_text(json.dumps(dict.fromkeys(joints.names, motor)))
    (tmp_path / "arm.urdf").write_text(rig.arm.urdf)
    files = ("--calibration", tmp_path / "calibration.json", "--robot", tmp_path / "arm.urdf")
    words = (*files, "--board", SPEC)
    done = run.done("lerobot", tmp_path, *words, "-o", tmp_path / "new.json", "--json")
    elbow = done.document["offsets"][joints.names[2]]
    assert np.degrees(elbow["offset"]) == pytest.approx(3.0, abs=0.3)
    # shares of ranges, none of which was driven to its end
    write_dataset(tmp_path, "v3.0", q / 1.8, **written)
    again = run.done("lerobot", tmp_path, *words, "-o", tmp_path / "new.json", "--json")
    assert "joints are read as shares" in again.err
    assert again.document["offsets"][joints.names[2]]["offset"] == pytest.approx(elbow["offset"])
    new = json.loads((tmp_path / "new.json").read_text())
    assert new[joints.names[2]]["homing_offset"] == pytest.approx(7 - 34, abs=4)
    assert new[joints.names[0]]["homing_offset"] == 7
