"""Pictures and a film of an arm with a tag on its tip, rendered, for the tests of recordings."""

import shutil
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from rendering import Camera, Desk, board, tag, write_video

from calib import CalibError
from calib.recording.board import Board
from calib.recording.joint_table import read_joints
from calib.recording.lens import Lens
from calib.recording.setting import Setup
from calib.recording.tag_logs import log_pictures

CAMERA = Camera(size=(640, 480), focal=600.0)
BOARD = Board.parse("5x4:40mm:31mm:5x5_100")
AROUND = {20: (-0.02, -0.08), 21: (0.4, -0.08), 22: (0.4, 0.3), 23: (-0.02, 0.3)}
CORNERS = tuple(tag(n, 0.04, (*at, 0.0, 0.1 * n)) for n, at in AROUND.items())
LENS = Lens(
    CAMERA.size, np.full(2, CAMERA.focal), CAMERA.centre, np.array([CAMERA.k1, 0.0, 0.0, 0.0, 0.0])
)


def desk(**more):
    lying = board(5, 4, 0.04, 0.031, (0.29, -0.02, 0.0, 0.1))
    return Desk(**{"camera": CAMERA, "still": (lying, *CORNERS), "height": 0.025, **more})


def truth_on_board(scene, q):
    sticker = scene.still[0]
    turn, at = sticker.frame
    world = np.c_[scene.tip(q), np.full(len(q), scene.height)]
    return ((world - at) @ turn)[:, :2] + np.array(BOARD.size) / 2


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """Sixteen pictures, named so that their order is not that of the alphabet."""
    folder = tmp_path_factory.mktemp("shot")
    rng = np.random.default_rng(0)
    scene = desk()
    (folder / "p").mkdir()
    q = []
    while len(q) < 16:
        row = rng.uniform([0.0, 0.0, -1.2], [1.3, 1.4, 1.2])
        p = scene.tip_pixels(row)[0]
        if 30 < p[0] < 610 and 30 < p[1] < 450:
            cv2.imwrite(str(folder / "p" / f"img_{len(q)}.png"), scene.picture(row, rng))
            q.append(row)
    np.savetxt(folder / "joints.csv", q, delimiter=",", header="a,b,c", comments="")
    LENS.save(folder / "lens.json")
    rows = "\n".join(f"{n},{x},{y}" for n, (x, y) in AROUND.items())
    (folder / "corners.csv").write_text(f"tag,x,y\n{rows}\n")
    return SimpleNamespace(folder=folder, scene=scene, q=np.array(q), pictures=folder / "p")


@pytest.fixture
def copy(shot, tmp_path):
    """The same, to be spoilt."""
    shutil.copytree(shot.folder, tmp_path / "s")
    return SimpleNamespace(folder=tmp_path / "s", scene=shot.scene, q=shot.q)


def make(folder, setting=None, joints="joints.csv", **more):
    return log_pictures(folder / "p", read_joints(folder / joints), setting or Setup(7), **more)


def refused(match, call, *values, **named):
    with pytest.raises(CalibError, match=match) as caught:
        call(*values, **named)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """Eight seconds at 20 frames a second, stops between moves; joints by a clock of their own."""
    folder = tmp_path_factory.mktemp("film")
    rng = np.random.default_rng(5)
    scene = Desk(
        Camera(size=(400, 300), focal=380.0), lengths=(0.18, 0.16), offsets=(0.0, 0.0), shadow=0.0
    )
    goals = rng.uniform([0.1, 0.2], [1.2, 1.4], (16, 2))

    def joints(t):
        t = np.atleast_1d(t)
        k = np.clip((t / 0.9).astype(int), 0, 14)
        s = np.clip((t / 0.9 - k) / 0.5, 0, 1)[:, None]
        s = s**3 * (10 - 15 * s + 6 * s**2)
        return goals[k] * (1 - s) + goals[k + 1] * s

    frames = np.arange(0, 8, 0.05)
    pictures = [scene.picture(q, rng) for q in joints(frames + 1.0)]
    write_video(str(folder / "run.mp4"), pictures, 20.0)
    write_video(str(folder / "run.avi"), pictures[:60], 20.0, "MJPG")
    time = np.arange(0, 12, 0.01)
    table = np.c_[time + 50.0, joints(time)]
    np.savetxt(folder / "joints.csv", table, delimiter=",", header="time,a,b", comments="")
    return SimpleNamespace(folder=folder, scene=scene, joints=read_joints(folder / "joints.csv"))
