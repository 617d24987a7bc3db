"""Logs from videos, and the commands: right where they are made, one line where they are not."""

import numpy as np
import pytest

pytest.importorskip("cv2")
import cv2
import shots
from rendering import Desk, tag, write_video
from shots import LENS, refused, truth_on_board

import calib
from calib import OptionError
from calib.recording.joint_table import read_joints
from calib.recording.setting import Setup
from calib.recording.tag_logs import log_video

shot, copy, film = shots.shot, shots.copy, shots.film


def test_a_video_becomes_rests(film):
    made = log_video(film.folder / "run.mp4", film.joints, Setup(7))
    assert abs(made.source["time_offset"] - 51.0) < 3e-3
    assert 5 <= len(made) <= 9
    miss = made.x - film.scene.tip_pixels(made.q)
    assert np.sqrt((miss**2).sum(1).mean()) < 0.15
    assert made.source["dropped"]["the arm moves"] > 40


def test_videos_that_make_no_log(film, tmp_path):
    run, joints = film.folder / "run.mp4", film.joints
    refused("tag 9 is in none of 160 frames: .* show 7", log_video, run, joints, Setup(9))
    refused("clocks are apart", log_video, run, joints, Setup(7), time_offset=500.0)
    refused("never rests", log_video, run, joints, Setup(7), time_offset=51.3)
    (tmp_path / "text.mp4").write_text("no video\n" * 200)
    refused("cannot be read", log_video, tmp_path / "text.mp4", joints, Setup(7))
    refused("cannot be read", log_video, tmp_path / "none.mp4", joints, Setup(7))
    refused("lens was calibrated with 640x480", log_video, run, joints, Setup(7, lens=LENS))
    twins = Desk(film.scene.camera, film.scene.lengths, still=(tag(7, 0.05, (0.1, 0.1, 0, 1)),))
    frames = [twins.picture(q, np.random.default_rng(0)) for q in joints.q[:600:50]]
    twice = tmp_path / "twins.mp4"
    write_video(str(twice), frames, 20.0)
    refused(r"twice in \d+ of 12 frames \(twins.mp4 at", log_video, twice, joints, Setup(7))
    (tmp_path / "p.csv").write_text("a,b\n0,1\n1,2\n")
    refused("a column 'time'", log_video, run, read_joints(tmp_path / "p.csv"), Setup(7))
    with pytest.raises(OptionError):
        log_video(run, joints, Setup(7), still=-1.0)


def test_the_commands(run, shot, film, tmp_path):
    done = run("tag", 7, "-o", tmp_path / "tag.svg", "--size", "30mm")
    assert done.code == 0
    assert "30 mm" in done.out
    done = run("tag", "--board", "5x4:40mm:31mm:5x5_100", "-o", tmp_path / "board.svg")
    assert done.code == 0
    assert run("tag", "-o", tmp_path / "x.svg").code == 2
    joints = ("--joints-file", shot.folder / "joints.csv", "--tag", 7)
    done = run(
        "log", shot.pictures, *joints, "-o", tmp_path / "l.csv", "--picture", tmp_path / "s.png"
    )
    assert done.code == 0
    assert cv2.imread(str(tmp_path / "s.png")).shape == (480, 640, 3)
    assert calib.read_log(tmp_path / "l.csv", joints=["a", "b", "c"]).unit == "px"
    done = run(
        "log", shot.pictures, *joints, "-o", tmp_path / "m.csv", "--board",
        "5x4:40mm:31mm:5x5_100", "--lens", shot.folder / "lens.json", "--tag-height", "25mm",
    )  # fmt: skip
    assert done.code == 0
    log = calib.read_log(tmp_path / "m.csv", joints=["a", "b", "c"])
    assert log.unit == "m"
    assert np.linalg.norm(log.x - truth_on_board(shot.scene, shot.q), axis=1).max() < 3e-3
    done = run("log", shot.pictures, "--tag", 7, "-o", tmp_path / "n.csv")
    assert done.code == 2
    assert "--joints-file" in done.err
    done = run("log", shot.pictures, *joints, "--still", "1", "-o", tmp_path / "n.csv")
    assert done.code == 2
