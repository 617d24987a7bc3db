"""Draw the pictures of docs/howto/webcam.md: what was seen, and the map over a photo.

python docs/make_webcam.py [FOLDER]
"""

from __future__ import annotations

import io
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[1]
WIDTH = 1064  # of the pictures [px]
sys.path.insert(0, str(ROOT / "tests"))
from rendering import Desk, board, tag  # noqa: E402

import calib  # noqa: E402
from calib.recording.board import parse_board  # noqa: E402
from calib.recording.motion_tables import read_joints  # noqa: E402
from calib.recording.pictures import list_pictures, read_picture, take_photo  # noqa: E402
from calib.recording.tag_logs import log_pictures  # noqa: E402
from calib.recording.tag_scene import TagScene, write_overlay  # noqa: E402
from calib.samples.lens import Lens  # noqa: E402


def render(folder: Path, count: int = 60) -> Desk:
    """Write pictures and their joints."""
    rng = np.random.default_rng(0)
    still = (board(7, 5, 0.024, 0.018, (0.36, -0.06, 0, 0.1)), tag(3, 0.03, (0.0, 0.25, 0, 0.3)))
    desk = Desk(still=still)
    (folder / "pictures").mkdir()
    rows = []
    while len(rows) < count:
        q = rng.uniform([-0.5, -0.1, -1.4], [1.9, 1.9, 1.4])
        p = desk.tip_pixels(q)[0]
        if (p > 40).all() and (p < np.array(desk.camera.size) - 40).all():
            cv2.imwrite(str(folder / "pictures" / f"img_{len(rows)}.jpg"), desk.picture(q, rng))
            rows.append(q)
    header = "shoulder,elbow,wrist"
    np.savetxt(folder / "joints.csv", rows, delimiter=",", header=header, comments="")
    return desk


def main(target: Path) -> None:
    """Render, log, draw."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        camera = render(folder).camera
        distortion = np.array([camera.k1, camera.k2, 0.0, 0.0, 0.0])
        lens = Lens(camera.size, np.full(2, camera.focal), camera.centre, distortion)
        table = read_joints(folder / "joints.csv")
        board_given = TagScene(7, board=parse_board("7x5:24mm:18mm:5x5_100"), lens=lens)
        made = log_pictures(folder / "pictures", table, TagScene(7))
        photo = read_picture(list_pictures(folder / "pictures")[7], "RGB")[0]
        write_overlay(folder / "seen.png", photo, board_given, made.pixels)
        save(Image.open(folder / "seen.png"), target / "webcam-seen.jpg")
        calib.write_log(made, folder / "log.csv")
        log = calib.read_log(folder / "log.csv", joints=list(made.joint_names))
        model = calib.train(log)
        shown = take_photo(list_pictures(folder / "pictures")[7], model.sensory.weights, "px")
        drawn = io.BytesIO()
        figure = calib.figures(replace(model, photo=shown))["photo"]
        figure.savefig(drawn, dpi=144, facecolor="white")
        save(Image.open(drawn), target / "webcam-map.jpg")


def save(picture: Image.Image, path: Path) -> None:
    """Write a picture as JPEG: its noise does not compress otherwise."""
    if picture.width > WIDTH:
        shape = (WIDTH, round(picture.height * WIDTH / picture.width))
        picture = picture.resize(shape, Image.Resampling.LANCZOS)
    picture.convert("RGB").save(path, quality=85, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "img")
