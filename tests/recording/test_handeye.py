"""Hand-eye: from rendered pictures of a board to where camera and board are."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import pytest
from boards import Rig
from rendering import Camera, Desk, board

import calib
from calib.arm.rotations import exponential, logarithm, matrix_of
from calib.errors import LogError, OptionError
from calib.recording.board import Board
from calib.recording.board_pictures import BoardPictures
from calib.recording.handeye import handeye
from calib.recording.joint_table import JointTable
from calib.recording.lens import Lens

SPEC = "7x5:24mm:18mm:5x5_100"
FLIP = np.diag([1.0, -1.0, -1.0])  # OpenCV's frame of a board has y down
CORNER = np.array([0.084, 0.06, 0.0])  # the middle of the board in OpenCV's frame


@dataclass(frozen=True, eq=False)
class Held(Camera):
    """A camera whose rotation (world to camera) is given."""

    turned: tuple = ()

    @property
    def rotation(self):
        return np.array(self.turned)


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
        camera = Held(
            focal=f, k1=k1, position=tuple(position), shift=(u - 639.5, v - 359.5),
            turned=tuple(map(tuple, world)),
        )  # fmt: skip
        desk = Desk(camera, still=(made,), noise=2.0, blur=0.6)
        taken.append(desk.picture([0.0] * 3, rng, arm=False))
    return rig, taken, JointTable("joints", rig.arm.joint_names, rig.q, None, None)


@pytest.mark.parametrize("in_hand", [True, False])
def test_camera_and_board_are_found_from_pictures(in_hand):
    rig, pictures, joints = shots(in_hand)
    found = handeye(rig.arm, pictures, joints, SPEC, "hand" if in_hand else "base")
    position, turn = rig.hand(rig.beta)
    off = np.subtract(found.hand["position"], position)
    assert np.linalg.norm(off) < 1e-3
    assert (abs(off) < 1.5 * np.array(found.hand["position_95"])).all()
    turned = matrix_of(np.array(found.hand["quaternion"])[None])[0]
    assert np.linalg.norm(logarithm((turned.T @ turn)[None])) < np.radians(0.15)
    assert found.used == found.pictures == 10
    assert found.reprojection["mean"] < 0.3
    assert found.to_json()["eye"] == ("hand" if in_hand else "base")
    assert abs(found.lens["focal"] - rig.lens[0]) < 2.0 + found.lens["focal_95"]


def corners(rig, seen=None, q=None, board=SPEC):
    """The corners of a rig as if they were found in pictures."""
    seen = rig.seen if seen is None else seen
    found = tuple(dict(enumerate(seen[rig.rows == k])) for k in range(len(rig.q)))
    names = tuple(f"{k:02d}.png" for k in range(len(rig.q)))
    return BoardPictures(
        Board.parse(board), rig.arm.joint_names, names, rig.q if q is None else q, found,
        (1280, 720), len(names), (),
    )  # fmt: skip


def lens_of(rig):
    f, u, v, k1 = rig.lens
    return Lens((1280, 720), np.array([f, f]), np.array([u, v]), np.array([k1, 0, 0, 0, 0]))


def solve(rig, eye=None, **changes):
    eye = eye or ("hand" if rig.in_hand else "base")
    return handeye(rig.arm, corners(rig, **changes), None, None, eye, lens=lens_of(rig))


@pytest.mark.parametrize("in_hand", [True, False])
def test_a_wrong_reading_is_named(in_hand):
    rig = Rig(in_hand, seed=1, pictures=12)
    ways = {
        "columns are exchanged": rig.q[:, [0, 2, 1, 3, 4, 5]],
        "wrist_2 counts the other way": rig.q * (1, 1, 1, 1, -1, 1),
        "degrees": np.degrees(rig.q),
        "1 row late": np.roll(rig.q, 1, axis=0),
    }
    for words, q in ways.items():
        with pytest.raises(LogError, match=words):
            solve(rig, q=q)
    with pytest.raises(LogError, match="squares measure"):
        solve(rig, board="7x5:25mm:18mm:5x5_100")
    with pytest.raises(OptionError, match="eye=") as told:
        solve(rig, eye="base" if in_hand else "hand")
    assert told.value.value == ("hand" if in_hand else "base")


@pytest.mark.parametrize(
    ("group", "step", "words"),
    [
        ("view.shift", 0.05, "was moved from 13.png on"),
        ("tool", 0.05, "in the hand from 13.png on"),
        ("lens", 60.0, "refocused or zoomed from 13.png on"),
    ],
)
def test_what_changed_on_the_way_is_told(group, step, words):
    rig = Rig(True, seed=2, pictures=20)
    moved = rig.beta.copy()
    moved[rig.structure.groups[group][0]] += step
    late = rig.rows >= 13
    seen = rig.seen.copy()
    rows = np.column_stack([rig.q[rig.rows], rig.corners])
    there, here = (rig.truth.predict(rows, beta) for beta in (moved, rig.beta))
    seen[late] += (there - here)[late]
    found = solve(rig, seen=seen)
    assert found.used == 13
    assert any(words in note for note in found.notes), found.notes


def test_a_shift_that_no_picture_tells_is_left_out_of_the_interval_up_to_it():
    rig = Rig(True, seed=3, pictures=16)
    found = solve(rig)
    whole, told = (found.hand[f"rotation_95{end}"] for end in ("", "_up_to_gauge"))
    assert max(told) < 0.2 * max(whole)
    assert max(found.hand["position_95"]) < 1e-3  # the arm is good, and the corners tell so
    # turned with the last joint, the other way than that, nothing is seen
    assert "no picture tells" in found.notes[-1]


def test_refusals_name_what_was_given():
    rig, pictures, joints = shots(True)
    with pytest.raises(OptionError, match="wrist"):
        handeye(rig.arm, pictures, joints, SPEC, "wrist")
    with pytest.raises(LogError, match="board"):
        handeye(rig.arm, pictures, joints, "9x9:24mm:18mm:4x4_100", "hand")


def test_the_command_says_where_the_camera_is(tmp_path, run):
    rig, pictures, joints = shots(True)
    folder = tmp_path / "shots"
    folder.mkdir()
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{k:02d}.png"), picture)
    table = tmp_path / "joints.csv"
    rows = [",".join(map(repr, row.tolist())) for row in joints.q]
    table.write_text("\n".join([",".join(joints.names), *rows]))
    transform = tmp_path / "rig.json"
    words = ["six_axis", folder, "--joints-file", table, "--board", SPEC, "--eye", "hand"]
    done = run("handeye", *words, "--transform", transform, "-o", tmp_path / "rig.calib", "--json")
    assert done.code == 0, done.err
    position, _ = rig.hand(rig.beta)
    assert np.allclose(done.document["hand"]["position"], position, atol=1e-3)
    frames = [each["child_frame_id"] for each in json.loads(transform.read_text())]
    assert frames == ["camera_frame", "board_frame"]
    told = run("handeye", *words)
    assert len(told.out.splitlines()) <= 10
    assert "limited by" in told.out
    assert calib.load(tmp_path / "rig.calib").about.joint_names == rig.arm.joint_names
