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
from calib.recording.handeye import handeye
from calib.recording.joint_table import JointTable

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


def test_the_other_way_round_is_found_by_trying_it():
    rig, pictures, joints = shots(True)
    with pytest.raises(OptionError, match="hand"):
        handeye(rig.arm, pictures, joints, SPEC, "base")


def test_a_board_that_was_moved_is_left_out_and_told():
    rig, pictures, _ = shots(True)
    other = shots(True, pictures=3, seed=5)
    mixed = [*pictures, *other[1]]
    q = np.concatenate([rig.q, rig.q[:3]])
    table = JointTable("joints", rig.arm.joint_names, q, None, None)
    found = handeye(rig.arm, mixed, table, SPEC, "hand")
    assert found.used == 10
    assert any("moved" in note for note in found.notes)


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
