"""Logs from pictures and videos: right where they are made, one line where they are not."""

from __future__ import annotations

import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("cv2")
import cv2
from calib_cli.app import app
from rendering import Camera, Desk, board, tag, write_video
from typer.testing import CliRunner

import calib
from calib.errors import CalibError, OptionError
from calib.recording.board import Board
from calib.recording.from_pictures import log_pictures
from calib.recording.from_video import Rows, log_video
from calib.recording.joint_table import read_joints
from calib.recording.lens import Lens
from calib.recording.pictures import list_pictures, read_picture
from calib.recording.setting import Setting, load_lens
from calib.recording.watch import read_layout
from calib.samples.tables import read_about

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
    return log_pictures(folder / "p", read_joints(folder / joints), setting or Setting(7), **more)


def test_pixels_in_the_order_of_numbers(shot):
    made = make(shot.folder)
    assert made.unit == "px"
    assert made.pictures[9:12] == ("img_9.png", "img_10.png", "img_11.png")
    miss = made.x - shot.scene.tip_pixels(shot.q)
    assert np.sqrt((miss**2).sum(1).mean()) < 0.1
    assert made.dropped == {}
    assert 0.01 < made.noise < 0.1


def test_rows_find_their_pictures_by_name(copy):
    order = np.random.default_rng(1).permutation(16)
    names = [f"folder/img_{k}.png" for k in order]
    rows = [",".join(map(repr, copy.q[k].tolist())) for k in order]
    lines = [f"{name},{row}" for name, row in zip(names, rows, strict=True)]
    (copy.folder / "named.csv").write_text("picture,a,b,c\n" + "\n".join(lines[:-1]) + "\n")
    made = make(copy.folder, joints="named.csv")
    assert made.pictures == tuple(f"img_{k}.png" for k in order[:-1])
    assert np.abs(made.x - shot_pixels(copy, order[:-1])).max() < 0.3
    assert any("1 pictures left out" in note for note in made.notes)


def shot_pixels(copy, order):
    return copy.scene.tip_pixels(copy.q[order])


def test_metres_by_the_board_and_the_height(shot):
    setting = Setting(7, board=BOARD, lens=LENS, tag_height=0.025)
    made = make(shot.folder, setting)
    miss = np.linalg.norm(made.x - truth_on_board(shot.scene, shot.q), axis=1)
    assert made.unit == "m"
    assert np.sqrt((miss**2).mean()) < 1e-3  # a small picture, 1.5 mm a pixel
    assert 0.3 * np.sqrt((miss**2).mean()) < 2 * made.noise < 5e-3
    flat = make(shot.folder, Setting(7, board=BOARD, lens=LENS))
    assert np.linalg.norm(flat.x - made.x, axis=1).max() > 5e-3


def test_metres_by_tags_around(shot):
    layout = read_layout(shot.folder / "corners.csv")
    made = make(shot.folder, Setting(7, tags_at=layout, lens=LENS, tag_height=0.025))
    assert np.linalg.norm(made.x - shot.scene.tip(shot.q), axis=1).max() < 1e-3
    raw = make(shot.folder, Setting(7, tags_at=layout))
    assert 1e-3 < np.linalg.norm(raw.x - shot.scene.tip(shot.q), axis=1).max() < 0.05


def test_the_pose_of_the_tag(shot):
    setting = Setting(7, board=BOARD, lens=LENS, tag_size=0.04, pose=True)
    made = make(shot.folder, setting)
    assert made.x.shape == (16, 3)
    assert np.abs(made.x[:, 2] - 0.025).max() < 0.02
    angle = shot.q.sum(1) - shot.scene.still[0].place[3]
    turned = 2 * np.arctan2(made.quaternion[:, 2], made.quaternion[:, 3])
    assert np.abs(np.angle(np.exp(1j * (turned - angle)))).max() < 0.02


def test_the_log_says_its_unit_to_train(shot, tmp_path):
    made = make(shot.folder)
    for name in ("log.csv", "log.parquet"):
        made.write(tmp_path / name)
        log = calib.read_log(tmp_path / name, joints=["a", "b", "c"])
        assert log.unit == "px"
        assert (log.x == made.x).all()
        about = read_about(tmp_path / name)
        assert about["noise"] == made.noise
        assert about["tag"] == 7
        assert calib.read_log(tmp_path / name, joints=["a", "b", "c"], unit="mm").unit == "mm"


def test_a_camera_that_was_bumped_is_told_and_positions_stay(shot, tmp_path):
    setting = Setting(7, board=BOARD, lens=LENS, tag_height=0.025)
    before = make(shot.folder, setting)
    bumped = Camera(CAMERA.size, CAMERA.focal, position=(0.21, -0.25, 0.9), roll=0.03)
    scene = desk(camera=bumped)
    rng = np.random.default_rng(2)
    (tmp_path / "p").mkdir()
    for k, row in enumerate(shot.q[:6]):
        cv2.imwrite(str(tmp_path / "p" / f"{k}.png"), scene.picture(row, rng))
    np.savetxt(tmp_path / "joints.csv", shot.q[:6], delimiter=",", header="a,b,c", comments="")
    after = make(tmp_path, setting, since=before.about())
    assert np.linalg.norm(after.x - before.x[:6], axis=1).max() < 2e-3
    assert any("the camera moved by" in note and "mm" in note for note in after.notes)


def test_a_bump_within_a_recording_is_told(shot, copy):
    bumped = desk(camera=Camera(CAMERA.size, CAMERA.focal, position=(0.205, -0.25, 0.9)))
    rng = np.random.default_rng(3)
    for k in range(10, 16):
        cv2.imwrite(str(copy.folder / "p" / f"img_{k}.png"), bumped.picture(copy.q[k], rng))
    made = make(copy.folder, Setting(7, board=BOARD, lens=LENS, tag_height=0.025))
    assert any("moved by" in n and "about picture 11" in n for n in made.notes)
    miss = np.linalg.norm(made.x - truth_on_board(copy.scene, copy.q), axis=1)
    assert miss.max() < 2.5e-3


def refused(match, call, *values, **named):
    with pytest.raises(CalibError, match=match) as caught:
        call(*values, **named)
    assert "\n" not in str(caught.value)


def test_no_such_tag(shot):
    refused(
        r"tag 8 is in none of 16 pictures: .* show .*7 \(\d+ times\)", make, shot.folder, Setting(8)
    )


def test_twice_in_a_picture(copy):
    scene = desk(still=(tag(7, 0.05, (0.1, 0.28, 0, 1)),))
    picture = scene.picture(copy.q[3], np.random.default_rng(4))
    cv2.imwrite(str(copy.folder / "p" / "img_3.png"), picture)
    refused("twice in 1 of 16 pictures \\(img_3.png\\)", make, copy.folder)


def test_at_one_place(copy):
    for k in range(16):
        shutil.copy(copy.folder / "p" / "img_0.png", copy.folder / "p" / f"img_{k}.png") if k else 0
    refused("stays at .* while the joints move", make, copy.folder)


def test_the_arm_never_moves(copy):
    np.savetxt(
        copy.folder / "same.csv",
        np.tile(copy.q[0], (16, 1)),
        delimiter=",",
        header="a,b,c",
        comments="",
    )
    refused("never moves", make, copy.folder, joints="same.csv")


def test_counts_and_sizes_and_damage(copy):
    folder = copy.folder
    whole = (folder / "p" / "img_4.png").read_bytes()
    (folder / "p" / "img_4.png").write_bytes(whole[: len(whole) // 2])
    picture = cv2.imread(str(folder / "p" / "img_5.png"), 0)
    packed = cv2.imencode(".jpg", picture)[1].tobytes()
    (folder / "p" / "img_5.png").unlink()
    (folder / "p" / "img_5.jpg").write_bytes(packed[: len(packed) // 2])
    (folder / "p" / "img_6.png").write_text("no picture")
    made = make(folder)
    assert len(made) == 13
    assert made.dropped == {"cut off or damaged": 3}
    assert sum("cut off; left out" in note for note in made.notes) == 2
    assert any("img_6.png is no picture" in note for note in made.notes)
    cv2.imwrite(str(folder / "p" / "img_7.png"), picture[:400])
    refused("img_7.png is 640x400, the pictures before it 640x480", make, folder)
    (folder / "p" / "img_7.png").unlink()
    refused("15 pictures and 16 rows", make, folder)
    for path in (folder / "p").iterdir():
        path.write_text("nothing")
    shutil.copy(folder / "p" / "img_1.png", folder / "p" / "img_7.png")
    refused("no picture in .* can be read", make, folder)


def test_where_there_are_no_pictures(shot, tmp_path):
    joints = read_joints(shot.folder / "joints.csv")
    refused("no folder", log_pictures, tmp_path / "none", joints, Setting(7))
    refused("no pictures in", log_pictures, tmp_path, joints, Setting(7))
    found = list_pictures(str(shot.pictures / "img_1*.png"))
    assert [p.name for p in found] == ["img_1.png", *(f"img_1{k}.png" for k in range(6))]


def test_settings_that_cannot_be(shot):
    layout = read_layout(shot.folder / "corners.csv")
    refused("may be off by centimetres", Setting, 7, board=BOARD)
    refused("`tag_height` is given without", Setting, 7, tag_height=0.02)
    refused("expected one of them", Setting, 7, board=BOARD, lens=LENS, tags_at=layout)
    refused("needs `tag_size`", Setting, 7, lens=LENS, pose=True)
    refused("on the tip and in `tags_at`", Setting, 20, tags_at=layout)
    refused("printed on the board too", Setting, 7, "5x5_100", BOARD, lens=LENS)
    refused("expected `board` too", load_lens, shot.pictures, None)
    refused("is no lens", load_lens, shot.folder / "joints.csv", None)
    other = Lens((320, 240), LENS.focal, LENS.centre, LENS.distortion)
    refused("lens was calibrated with 320x240", make, shot.folder, Setting(7, lens=other))
    refused(
        "`tag_height=0.02` needs `lens`",
        make,
        shot.folder,
        Setting(7, tags_at=layout, tag_height=0.02),
    )


def test_a_reference_that_is_not_there(shot, tmp_path):
    other = Board.parse("5x4:40mm:31mm:4x4_50")
    refused("at most 0 found .* 8 expected", make, shot.folder, Setting(7, board=other, lens=LENS))
    refused("the board is in 0 of 16 pictures", load_lens, shot.pictures, other)
    (tmp_path / "three.csv").write_text("tag,x,y\n1,0,0\n2,1,0\n3,1,1\n")
    refused("expected four tags", read_layout, tmp_path / "three.csv")


def test_degrees_are_noticed(copy):
    np.savetxt(
        copy.folder / "deg.csv", np.rad2deg(copy.q), delimiter=",", header="a,b,c", comments=""
    )
    refused("are these degrees", read_joints, copy.folder / "deg.csv")
    assert np.allclose(read_joints(copy.folder / "deg.csv", degrees=True).q, copy.q)


def test_rotated_and_deep_pictures_are_read(tmp_path):
    grey = np.arange(96, dtype=np.uint8).reshape(8, 12)
    cv2.imwrite(str(tmp_path / "deep.png"), grey.astype(np.uint16) * 256)
    assert (read_picture(tmp_path / "deep.png") == grey).all()
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(grey).save(tmp_path / "turned.png", exif=exif)
    assert read_picture(tmp_path / "turned.png").shape == (12, 8)


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


def test_a_video_becomes_rests(film):
    made = log_video(film.folder / "run.mp4", film.joints, Setting(7))
    assert abs(made.source["time_offset"] - 51.0) < 3e-3
    assert 5 <= len(made) <= 9
    miss = made.x - film.scene.tip_pixels(made.q)
    assert np.sqrt((miss**2).sum(1).mean()) < 0.15
    assert made.dropped["the arm moves"] > 40


def test_a_video_becomes_slow_frames(film):
    rows = Rows(time_offset=51.0, still=0.4)
    made = log_video(film.folder / "run.mp4", film.joints, Setting(7), rows)
    assert len(made) > 30
    miss = np.linalg.norm(made.x - film.scene.tip_pixels(made.q), axis=1)
    assert np.median(miss) < 0.2


def test_videos_that_make_no_log(film, tmp_path):
    run, joints = film.folder / "run.mp4", film.joints
    refused("tag 9 is in none of 160 frames: .* show 7", log_video, run, joints, Setting(9))
    refused("clocks are apart", log_video, run, joints, Setting(7), Rows(time_offset=500.0))
    refused("never rests", log_video, run, joints, Setting(7), Rows(51.3, max_gap=0.1))
    (tmp_path / "text.mp4").write_text("no video\n" * 200)
    refused("no video that OpenCV can read", log_video, tmp_path / "text.mp4", joints, Setting(7))
    refused("there is no file", log_video, tmp_path / "none.mp4", joints, Setting(7))
    (tmp_path / "p.csv").write_text("a,b\n0,1\n1,2\n")
    refused("a column 'time'", log_video, run, read_joints(tmp_path / "p.csv"), Setting(7))
    with pytest.raises(OptionError):
        Rows(still=-1.0)


def test_a_video_that_is_cut_off_says_so(film, tmp_path):
    whole = (film.folder / "run.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2])
    made = log_video(tmp_path / "cut.avi", film.joints, Setting(7), Rows(51.0, still=0.5))
    assert any("it is cut off" in note for note in made.notes)


def test_opencv_and_its_decoders_are_silent(film, copy, tmp_path):
    whole = (film.folder / "run.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2 + 7])
    (tmp_path / "junk.mp4").write_bytes(bytes(range(256)) * 20)
    for path in list((copy.folder / "p").iterdir())[:3]:
        path.write_bytes(path.read_bytes()[:-2000])
    code = (
        "import sys\nfrom calib.errors import CalibError\n"
        "from calib.recording.video import Video\n"
        "from calib.recording.pictures import list_pictures, read_picture\n"
        "for path in sys.argv[2:]:\n"
        "    try:\n        sum(1 for _ in Video(path).frames())\n"
        "    except CalibError:\n        pass\n"
        "for path in list_pictures(sys.argv[1]):\n"
        "    try:\n        read_picture(path)\n"
        "    except CalibError:\n        pass\n"
    )
    names = [str(copy.folder / "p"), str(tmp_path / "cut.avi"), str(tmp_path / "junk.mp4")]
    done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_the_commands(shot, film, tmp_path):
    done = run("tag", 7, "-o", tmp_path / "tag.svg", "--size", "30mm")
    assert done.exit_code == 0
    assert "30 mm" in done.output
    done = run("tag", "--board", "5x4:40mm:31mm:5x5_100", "-o", tmp_path / "board.svg")
    assert done.exit_code == 0
    assert run("tag", "-o", tmp_path / "x.svg").exit_code == 2
    joints = ("--joints-file", shot.folder / "joints.csv", "--tag", 7)
    done = run(
        "log", shot.pictures, *joints, "-o", tmp_path / "l.csv", "--picture", tmp_path / "s.png"
    )
    assert done.exit_code == 0
    assert cv2.imread(str(tmp_path / "s.png")).shape == (480, 640, 3)
    assert calib.read_log(tmp_path / "l.csv", joints=["a", "b", "c"]).unit == "px"
    done = run(
        "log", shot.pictures, *joints, "-o", tmp_path / "m.csv", "--board",
        "5x4:40mm:31mm:5x5_100", "--lens", shot.folder / "lens.json", "--tag-height", "25mm",
    )  # fmt: skip
    assert done.exit_code == 0
    log = calib.read_log(tmp_path / "m.csv", joints=["a", "b", "c"])
    assert log.unit == "m"
    assert np.linalg.norm(log.x - truth_on_board(shot.scene, shot.q), axis=1).max() < 3e-3
    done = run("log", shot.pictures, "--tag", 7, "-o", tmp_path / "n.csv")
    assert done.exit_code == 2
    assert "--joints-file" in done.output
    done = run("log", shot.pictures, *joints, "--still", "1", "-o", tmp_path / "n.csv")
    assert done.exit_code == 2


def test_a_clock_that_cannot_be_found_is_exit_three(film, tmp_path):
    other = np.loadtxt(film.folder / "joints.csv", delimiter=",", skiprows=1)
    other[:, 1:] = other[::-1, 1:] * [0.3, -1.0]
    np.savetxt(tmp_path / "other.csv", other, delimiter=",", header="time,a,b", comments="")
    done = run(
        "log", film.folder / "run.mp4", "--joints-file", tmp_path / "other.csv", "--tag", 7,
        "-o", tmp_path / "v.csv",
    )  # fmt: skip
    assert done.exit_code == 3
    assert not (tmp_path / "v.csv").exists()
    assert "--time-offset" in done.output
