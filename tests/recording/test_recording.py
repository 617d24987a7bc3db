"""Logs from pictures: right where they are made, one line where they are not."""

import shutil

import numpy as np
import pytest

pytest.importorskip("cv2")
import cv2
import shots
from rendering import Camera
from shots import BOARD, CAMERA, LENS, desk, make, refused, truth_on_board

import calib
from calib.recording.joint_table import read_joints
from calib.recording.lens import Lens, load_lens
from calib.recording.setting import Setup
from calib.samples.tables import open_source

shot, copy = shots.shot, shots.copy


def test_pixels_in_the_order_of_numbers(shot):
    made = make(shot.folder)
    assert made.unit == "px"
    assert made.pictures[9:12] == ("img_9.png", "img_10.png", "img_11.png")
    miss = made.x - shot.scene.tip_pixels(shot.q)
    assert np.sqrt((miss**2).sum(1).mean()) < 0.1
    assert made.source["dropped"] == {}
    assert 0.01 < made.source["noise"] < 0.1


def test_rows_find_their_pictures_by_name(copy):
    order = np.random.default_rng(1).permutation(16)
    names = [f"folder/img_{k}.png" for k in order]
    rows = [",".join(map(repr, copy.q[k].tolist())) for k in order]
    lines = [f"{name},{row}" for name, row in zip(names, rows, strict=True)]
    (copy.folder / "named.csv").write_text("picture,a,b,c\n" + "\n".join(lines[:-1]) + "\n")
    made = make(copy.folder, joints="named.csv")
    assert made.pictures == tuple(f"img_{k}.png" for k in order[:-1])
    assert np.abs(made.x - shot_pixels(copy, order[:-1])).max() < 0.3
    assert any("1 pictures, without joints, are left out" in note for note in made.notes)


def shot_pixels(copy, order):
    return copy.scene.tip_pixels(copy.q[order])


def test_metres_by_the_board_and_the_height(shot):
    setting = Setup(7, board=BOARD, lens=LENS, tag_height=0.025)
    made = make(shot.folder, setting)
    miss = np.linalg.norm(made.x - truth_on_board(shot.scene, shot.q), axis=1)
    assert made.unit == "m"
    assert np.sqrt((miss**2).mean()) < 1e-3  # a small picture, 1.5 mm a pixel
    assert 0.3 * np.sqrt((miss**2).mean()) < 2 * made.source["noise"] < 5e-3
    flat = make(shot.folder, Setup(7, board=BOARD, lens=LENS))
    assert np.linalg.norm(flat.x - made.x, axis=1).max() > 5e-3


def test_the_pose_of_the_tag(shot):
    setting = Setup(7, board=BOARD, lens=LENS, tag_size=0.04, pose=True)
    made = make(shot.folder, setting)
    assert made.x.shape == (16, 3)
    assert np.abs(made.x[:, 2] - 0.025).max() < 0.02
    angle = shot.q.sum(1) - shot.scene.still[0].place[3]
    turned = 2 * np.arctan2(made.orientation[:, 2], made.orientation[:, 3])
    assert np.abs(np.angle(np.exp(1j * (turned - angle)))).max() < 0.02


def test_the_log_says_its_unit_to_train(shot, tmp_path):
    made = make(shot.folder)
    for name in ("log.csv", "log.parquet"):
        calib.write_log(made, tmp_path / name)
        log = calib.read_log(tmp_path / name, joints=["a", "b", "c"])
        assert log.unit == "px"
        assert (log.x == made.x).all()
        about = open_source(tmp_path / name).about
        assert about["noise"] == made.source["noise"]
        assert about["tag"] == 7
        with pytest.raises(calib.LogError, match="states that its positions are in px"):
            calib.read_log(tmp_path / name, joints=["a", "b", "c"], unit="mm")


def test_a_bump_within_a_recording_is_told(shot, copy):
    bumped = desk(camera=Camera(CAMERA.size, CAMERA.focal, position=(0.205, -0.25, 0.9)))
    rng = np.random.default_rng(3)
    setting = Setup(7, board=BOARD, lens=LENS, tag_height=0.025)
    for k in range(13, 16):
        cv2.imwrite(str(copy.folder / "p" / f"img_{k}.png"), bumped.picture(copy.q[k], rng))
    made = make(copy.folder, setting)
    assert made.pictures == tuple(f"img_{k}.png" for k in range(13))
    assert any("3 pictures left out: the reference is elsewhere" in note for note in made.notes)
    miss = np.linalg.norm(made.x - truth_on_board(copy.scene, made.q), axis=1)
    assert miss.max() < 2.5e-3
    for k in range(10, 13):
        cv2.imwrite(str(copy.folder / "p" / f"img_{k}.png"), bumped.picture(copy.q[k], rng))
    refused("in 6 of 16 pictures: was the camera bumped", make, copy.folder, setting)


def test_no_such_tag(shot):
    refused(
        r"tag 8 is in none of 16 pictures: .* show .*7 \(\d+ times\)", make, shot.folder, Setup(8)
    )


def test_an_arm_or_a_tag_that_never_moves(copy):
    same = np.tile(copy.q[0], (16, 1))
    np.savetxt(copy.folder / "same.csv", same, delimiter=",", header="a,b,c", comments="")
    refused("never moves", make, copy.folder, joints="same.csv")
    for k in range(1, 16):
        shutil.copy(copy.folder / "p" / "img_0.png", copy.folder / "p" / f"img_{k}.png")
    refused("stays at .* while the joints move", make, copy.folder)


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
    assert made.source["dropped"] == {"cut off or damaged": 3}
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


def test_pictures_may_be_named_one_by_one(run, shot, tmp_path):
    names = [str(shot.pictures / f"img_{k}.png") for k in range(16)]
    line = ("--joints-file", shot.folder / "joints.csv", "--tag", "7", "-o", tmp_path / "log.csv")
    done = run("log", *names, *line)
    assert done.code == 0, done.err
    assert "16 rows" in done.out
    assert run("log", "a.mcap", "b.mcap", "-o", tmp_path / "no.csv").code == 2


def test_settings_that_cannot_be(shot):
    refused("may be off by centimetres", Setup, 7, board=BOARD)
    refused("`tag_height` is given without", Setup, 7, tag_height=0.02)
    refused("needs `lens` and `tag_size`", Setup, 7, lens=LENS, pose=True)
    refused("printed on the board too", Setup, 7, "5x5_100", BOARD, lens=LENS)
    refused("expected `board` too", load_lens, shot.pictures, None)
    refused("is no lens", load_lens, shot.folder / "joints.csv", None)
    other = Lens((320, 240), LENS.focal, LENS.centre, LENS.distortion)
    refused("lens was calibrated with 320x240", make, shot.folder, Setup(7, lens=other))


def test_degrees_are_noticed(copy):
    np.savetxt(
        copy.folder / "deg.csv", np.rad2deg(copy.q), delimiter=",", header="a,b,c", comments=""
    )
    refused("are these degrees", read_joints, copy.folder / "deg.csv")
    assert np.allclose(read_joints(copy.folder / "deg.csv", degrees=True).q, copy.q)
