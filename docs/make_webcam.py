"""Draw the picture of docs/howto/webcam.md: what `calib log --picture` shows of rendered pictures.

python docs/make_webcam.py [FOLDER]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from rendering import Desk, board, tag  # noqa: E402

from calib.recording.board import Board  # noqa: E402
from calib.recording.from_pictures import log_pictures  # noqa: E402
from calib.recording.joint_table import read_joints  # noqa: E402
from calib.recording.lens import Lens  # noqa: E402
from calib.recording.pictures import list_pictures, read_picture  # noqa: E402
from calib.recording.seen import write_seen  # noqa: E402
from calib.recording.setting import Setting  # noqa: E402


def render(folder: Path, count: int = 30) -> Desk:
    """Write pictures and their joints."""
    rng = np.random.default_rng(0)
    still = (board(7, 5, 0.024, 0.018, (0.36, -0.06, 0, 0.1)), tag(3, 0.03, (0.0, 0.25, 0, 0.3)))
    desk = Desk(still=still)
    (folder / "pictures").mkdir()
    rows = []
    while len(rows) < count:
        q = rng.uniform([-0.2, 0.0, -1.2], [1.3, 1.4, 1.2])
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
        setting = Setting(7, board=Board.parse("7x5:24mm:18mm:5x5_100"), lens=lens)
        made = log_pictures(folder / "pictures", read_joints(folder / "joints.csv"), setting)
        photo = read_picture(list_pictures(folder / "pictures")[7], colour=True)
        path = target / "webcam-seen.png"
        write_seen(path, photo, setting, made.pixels)
        shrink(path)


def shrink(path: Path) -> None:
    """Write a picture again with fewer pixels and colours: its noise does not compress."""
    picture = Image.open(path).convert("RGB").resize((800, 450), Image.Resampling.LANCZOS)
    few = picture.quantize(64, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(path, optimize=True)  # an octree keeps the few coloured marks


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "img")
