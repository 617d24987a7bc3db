"""What a real camera brings: rolling shutter, autofocus, tilted tags, clipped boards.

    python benchmarks/camera_real.py [--only NAME] [--pictures 24]

Everything is rendered by tests/rendering.py, 1280x720, the tag on the board's plane, and logged as
users do. Printed are the log's error against the truth, the noise that the log states (both rms
along an axis), rows that were taken, and what was said.
"""

import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from tables import typed

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from camera import BOARD, DESK, LYING, NAMES, on_board, postures, stops
from rendering import Camera, Desk, Sticker, board, write_video

from calib.errors import CalibError
from calib.recording.motion_tables import JointTable
from calib.recording.tag_logs import log_pictures, log_video
from calib.recording.tag_scene import TagScene
from calib.samples.lens import Lens
from calib.samples.samples import Samples


def lens_of(camera: Camera, stretch: float = 1.0) -> Lens:
    """Return the true lens, its focal length stretched."""
    bent = np.array([camera.k1, camera.k2, 0.0, 0.0, 0.0])
    return Lens(camera.size, np.full(2, stretch * camera.focal), camera.centre, bent)


METRES = TagScene(7, board=BOARD, lens=lens_of(DESK.camera))
PIXELS = TagScene(7)


def shots(
    desk: Desk, count: int, cameras: Callable[[int], Camera] | None = None
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return postures and their pictures; each may have a camera of its own."""
    rng = np.random.default_rng(4)
    q = postures(desk, count, rng)
    pictures = []
    for k, row in enumerate(q):
        seen = desk if cameras is None else replace(desk, camera=cameras(k))
        pictures.append(seen.picture(row, rng))
    return q, pictures


def logged(q: np.ndarray, pictures: list[np.ndarray], scene: TagScene) -> Samples:
    """Make the log of pictures."""
    with tempfile.TemporaryDirectory() as folder:
        for k, picture in enumerate(pictures):
            cv2.imwrite(f"{folder}/img_{k}.png", picture)
        names = tuple(f"img_{k}.png" for k in range(len(pictures)))
        return log_pictures(folder, JointTable("joints", tuple(NAMES), q, None, names), scene)


def told(name: str, desk: Desk, make: Callable[[], Samples], lying: Sticker = LYING) -> None:
    """Print how far a log is off, and what it says."""
    try:
        log = make()
    except CalibError as error:
        print(f"{name}: refused: {error}")
        return
    metres = log.unit == "m"
    miss = log.x - (on_board(desk, log.q, lying) if metres else desk.tip_pixels(log.q))
    scale, unit = (1e3, "mm") if metres else (1.0, "px")
    rms = scale * np.sqrt(np.square(miss).mean())
    worst = scale * np.linalg.norm(miss, axis=1).max()
    print(
        f"{name}: rms {rms:.3f} {unit}, stated {scale * log.source['noise']:.3f}, "
        f"worst {worst:.3f} {unit}, {len(log)} rows"
    )
    for note in log.notes:
        print(f"    {note}")


def clipped(count: int) -> None:
    """A board that leaves the picture: fewer and fewer of its 24 corners are in it."""
    for shift in (0.0, 0.06, 0.10, 0.12, 0.14):
        lying = board(7, 5, 0.024, 0.018, (0.36 + shift, -0.06 - shift, 0.0, 0.1))
        desk = replace(DESK, still=(lying,))
        q, pictures = shots(desk, count)
        seen = desk.camera.project(lying.outline())
        share = np.mean(((seen > 0) & (seen < desk.camera.size)).all(1))
        name = f"clipped, {100 * share:.0f} % of the outline in the picture"
        told(name, desk, lambda q=q, p=pictures: logged(q, p, METRES), lying)


def tilted(count: int) -> None:
    """A tag that leans on the tip: its centre stays where it is."""
    for degrees in (0, 30, 45, 60, 70, 75, 80):
        desk = replace(DESK, tip_tilt=(0.0, np.radians(degrees), 0.0))
        q, pictures = shots(desk, count)
        told(f"tag tilted by {degrees} deg", desk, lambda q=q, p=pictures: logged(q, p, METRES))


def focus(count: int) -> None:
    """Autofocus: the focal length changes by 1 % between pictures, or since the lens was made."""
    rng = np.random.default_rng(2)
    change = 1.0 + 0.01 * rng.uniform(-1, 1, count)

    def camera(k: int) -> Camera:
        return replace(DESK.camera, focal=DESK.camera.focal * change[k])

    def stepped(k: int) -> Camera:
        return replace(DESK.camera, focal=DESK.camera.focal * (1.01 if k >= count // 2 else 1.0))

    for name, cameras in (("random", camera), ("once, halfway", stepped)):
        q, pictures = shots(DESK, count, cameras=cameras)
        for what, scene in (("metres", METRES), ("pixels", PIXELS)):
            told(
                f"focal length +-1 %, {name}, {what}",
                DESK,
                lambda q=q, p=pictures, s=scene: logged(q, p, s),
            )
    q, pictures = shots(DESK, count)
    other = replace(METRES, lens=lens_of(DESK.camera, 1.01))
    told("lens made at another focus (1 %)", DESK, lambda: logged(q, pictures, other))


def shutter(_count: int) -> None:
    """A rolling shutter that takes 30 ms from the first row to the last, in a video of 15 s."""
    rng = np.random.default_rng(3)
    joints, rate, bands, last = stops(postures(DESK, 30, rng)), 15.0, 12, 0.03
    table_time = np.arange(0.0, 22.0, 0.01)
    table = JointTable("joints", tuple(NAMES), joints(table_time), table_time + 100.0, None)
    edges = np.linspace(0, DESK.camera.size[1], bands + 1).astype(int)
    for name, readout in (("global", 0.0), ("rolling, 30 ms", last)):
        frames = []
        for t in 2.0 + np.arange(0.0, 15.0, 1.0 / rate):
            when = t + readout * (np.arange(bands) + 0.5) / bands
            q = joints(when if readout else np.array([t]))
            parts = {}
            picture = None
            for k, row in enumerate(q):
                key = row.tobytes()
                if key not in parts:
                    parts[key] = DESK.picture(row, rng)
                picture = parts[key].copy() if picture is None else picture
                picture[edges[k] : edges[k + 1]] = parts[key][edges[k] : edges[k + 1]]
            frames.append(picture)
        with tempfile.TemporaryDirectory() as folder:
            write_video(f"{folder}/run.mp4", frames, rate)
            for what, still in (
                ("rests", None),
                ("in motion up to 0.5 rad/s", 0.5),
                ("in motion up to 3 rad/s", 3.0),
            ):

                def made(still: float | None = still, folder: str = folder) -> Samples:
                    return log_video(f"{folder}/run.mp4", table, PIXELS, still=still)

                told(f"{name} shutter, {what}", DESK, made)


CASES = {f.__name__: f for f in (clipped, tilted, focus, shutter)}


def main() -> None:
    """Run all."""
    options = typed(__doc__, only=tuple(CASES), pictures=24)
    cv2.setNumThreads(1)
    for name, case in CASES.items():
        if options.only in (None, name):
            case(options.pictures)


if __name__ == "__main__":
    main()
