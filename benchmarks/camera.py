"""How well pictures become a log: tips in pixels and metres, found or not, time, clocks.

    python benchmarks/camera.py [--pictures 40]

Everything is rendered by tests/rendering.py, 1280x720, and compared with its own projection.
"""

import argparse
import sys
import time
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from rendering import Camera, Desk, board, board_shots, tag

from calib.recording.board import Board, BoardFinder
from calib.recording.lens import calibrate_lens
from calib.recording.reference import PlaneReference, find_pose
from calib.recording.tags import TagFinder

BOARD = Board.parse("7x5:24mm:18mm:5x5_100")


def rms(miss: np.ndarray) -> float:
    """Root mean square distance."""
    return float(np.sqrt(np.square(miss).sum(-1).mean()))


def shoot(desk: Desk, count: int, rng: np.random.Generator):
    """Yield postures, where their tag is, and their pictures."""
    while count:
        q = rng.uniform([-0.2, 0.0, -1.2], [1.3, 1.4, 1.2])
        p = desk.tip_pixels(q)[0]
        if (p > 40).all() and (p < np.array(desk.camera.size) - 40).all():
            count -= 1
            yield q, p, desk.picture(q, rng)


def pixels(name: str, desk: Desk, count: int) -> None:
    """Print how well tips are found."""
    finder, rng = TagFinder(wanted=[desk.tip_tag]), np.random.default_rng(1)
    miss, found, wrong, spent = [], 0, 0, 0.0
    for _, p, picture in shoot(desk, count, rng):
        start = time.process_time()
        tags = finder.find(picture)
        spent += time.process_time() - start
        found += len(tags) == 1
        wrong += any(np.linalg.norm(t.centre - p) > 2 for t in tags)
        miss += [t.centre - p for t in tags if t.sharp][:1]
    print(
        f"{name:34s} rms {rms(np.array(miss)):.3f} px, found {found} of {count}, wrong {wrong}, "
        f"{1e3 * spent / count:.0f} ms a picture"
    )


def metres(height: float, place: tuple[float, ...], count: int, seed: int) -> None:
    """Print how well they are placed on a board."""
    rng = np.random.default_rng(seed)
    lying = board(7, 5, 0.024, 0.018, place)
    desk = Desk(still=(lying,), height=height, seed=seed)
    finder, tags = BoardFinder(BOARD), TagFinder(wanted=[7])
    shots, _ = board_shots(desk, lying, 10, rng)
    lens, _ = calibrate_lens([finder.find(s) for s in shots], BOARD, desk.camera.size)
    seen, tips, corners = [], [], []
    for q, _, picture in shoot(desk, count, rng):
        corners.append(finder.find(picture))
        seen += [t.centre for t in tags.find(picture)]
        tips.append(desk.tip(q)[0])
    numbers = sorted(set().union(*corners))
    middle = np.array([np.median([c[n] for c in corners if n in c], axis=0) for n in numbers])
    pose = find_pose(lens, BOARD.corners()[numbers], middle)
    x = PlaneReference(lens, pose, height).positions(np.array(seen))
    turn, at = lying.frame
    world = np.c_[tips, np.full(len(tips), height)]
    truth = ((world - at) @ turn)[:, :2] + np.array(BOARD.size) / 2
    print(
        f"metres, tag {1e3 * height:2.0f} mm up, seed {seed}: rms {1e3 * rms(x - truth):.3f} mm, "
        f"lens rms {lens.rms:.3f} px of 10 shots, pose rms {pose.rms:.3f} px"
    )


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=40)
    count = parser.parse_args().pictures
    cv2.setNumThreads(1)
    still = (
        tag(3, 0.03, (0.0, 0.25, 0, 0.3)),
        board(7, 5, 0.024, 0.018, (0.38, -0.08, 0, 0.1)),
        tag(12, 0.05, (0.45, 0.2, 0, 1.0)),
    )
    print(f"OpenCV {cv2.__version__}, one core, process time")
    pixels("sharp, decoys", Desk(still=still), count)
    pixels("blur 1.2, noise 4, JPEG 80", Desk(still=still, blur=1.2, noise=4, quality=80), count)
    pixels("a tag of 20 mm", Desk(still=still, tip_size=0.02), count)
    pixels("640x480", Desk(still=still, camera=Camera(size=(640, 480), focal=600.0)), count)
    for seed, height in enumerate((0.0, 0.025, 0.0)):
        metres(height, (0.36, -0.06, 0.0, 0.1), min(count, 20), seed)


if __name__ == "__main__":
    main()
