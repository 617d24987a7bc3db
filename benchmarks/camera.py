"""From rendered pictures to a log, and to a calibrated arm: pixels, metres, a video, a bump.

    python benchmarks/camera.py [--pictures 58] [--video 30] [--folder KEPT]

Everything is rendered by tests/rendering.py, 1280x720, and read by `calib log` as users do.
Errors of the calibrated arm are distances to its true position at postures that no picture shows.
"""

import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from chains import chain_urdf, turning
from rendering import Camera, Desk, Sticker, board, board_shots, tag, write_video
from tables import typed

import calib
from calib.recording.board import parse_board
from calib.recording.lens import load_lens
from calib.recording.motion_tables import read_joints
from calib.recording.tag_logs import log_pictures, log_video
from calib.recording.tag_scene import TagScene

BOARD = parse_board("7x5:24mm:18mm:5x5_100")
LYING = board(7, 5, 0.024, 0.018, (0.36, -0.06, 0.0, 0.1))
DESK = Desk(
    still=(LYING, tag(3, 0.03, (0.0, 0.25, 0, 0.3))),
    lengths=(0.186, 0.133, 0.0972),  # the URDF says 0.18, 0.14, 0.09
    offsets=(0.03, -0.045, 0.02),
)
BUMPED = replace(DESK, camera=Camera(position=(0.215, -0.24, 0.905), roll=0.035))
LOWER, UPPER = np.array([-0.2, 0.0, -1.2]), np.array([1.3, 1.4, 1.2])
NAMES = ["j1", "j2", "j3"]


def urdf() -> str:
    """Return the description that the arm does not quite follow."""
    ends = zip((0.0, 0.18, 0.14), LOWER, UPPER, strict=True)
    parts = [turning(xyz=f"{at} 0 0", lower=str(low), upper=str(high)) for at, low, high in ends]
    return chain_urdf(*parts, tip="0.09 0 0")


def stops(goals: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return joints by time [s]: half a second on the way to each goal, and half a second there."""

    def joints(t: np.ndarray) -> np.ndarray:
        k = np.clip(t.astype(int), 0, len(goals) - 2)
        s = np.clip((t - k) / 0.5, 0, 1)[:, None]
        s = s**3 * (10 - 15 * s + 6 * s**2)
        return goals[k] * (1 - s) + goals[k + 1] * s

    return joints


def postures(desk: Desk, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return postures whose tag is in the picture."""
    found: list[np.ndarray] = []
    while len(found) < count:
        q = rng.uniform(LOWER, UPPER)
        p = desk.tip_pixels(q)[0]
        if (p > 40).all() and (p < np.array(desk.camera.size) - 40).all():
            found.append(q)
    return np.array(found)


def shoot(folder: Path, desk: Desk, count: int, seed: int) -> None:
    """Write pictures and joints, and ten shots of the board."""
    if (folder / "joints.csv").exists():
        return
    rng = np.random.default_rng(seed)
    for name in ("pictures", "shots"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    q = postures(desk, count, rng)
    for k, row in enumerate(q):
        cv2.imwrite(str(folder / "pictures" / f"img_{k}.png"), desk.picture(row, rng))
    for k, shot in enumerate(board_shots(desk, LYING, 10, rng)):
        cv2.imwrite(str(folder / "shots" / f"{k}.png"), shot)
    np.savetxt(folder / "joints.csv", q, delimiter=",", header=",".join(NAMES), comments="")


def film(folder: Path, desk: Desk, seconds: float, seed: int, rate: float = 15.0) -> None:
    """Write a video that goes from stop to stop, and joints by another clock."""
    if (folder / "joints.csv").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    joints = stops(postures(desk, int(seconds) + 12, rng))
    frames = 4.0 + np.arange(0.0, seconds, 1.0 / rate)
    write_video(str(folder / "run.mp4"), [desk.picture(q, rng) for q in joints(frames)], rate)
    t = np.arange(0.0, seconds + 8.0, 0.01)
    table = np.c_[t + 1000.0, joints(t)]
    header = ",".join(["time", *NAMES])
    np.savetxt(folder / "joints.csv", table, delimiter=",", header=header, comments="")


def on_board(desk: Desk, q: np.ndarray, lying: Sticker = LYING) -> np.ndarray:
    """Return true tips in the frame of the board that lies on the desk [m]."""
    turn, at = lying.frame
    world = np.c_[desk.tip(q), np.full(len(q), desk.height)]
    return ((world - at) @ turn)[:, :2] + np.array(BOARD.size) / 2


def judge(model: calib.Model, desk: Desk) -> str:
    """Return mean and largest error over the learned range, where the camera sees the tag."""
    q = postures(desk, 800, np.random.default_rng(99))
    q = q[((q >= model.about.lower) & (q <= model.about.upper)).all(1)]
    x = model.forward(q)
    lost = int((~np.isfinite(x).all(1)).sum())
    if model.about.unit == "px":
        near = 1e-4
        seen = desk.tip_pixels(q)
        world = np.c_[desk.tip(q), np.full(len(q), desk.height)]
        moved = [desk.camera.project(world + near * np.eye(3)[k]) - seen for k in (0, 1)]
        slope = np.stack(moved, axis=2) / near  # px per m
        away = np.linalg.norm(np.linalg.solve(slope, (x - seen)[..., None])[..., 0], axis=1)
    else:
        away = np.linalg.norm(x - on_board(desk, q), axis=1)
    text = f"mean {1e3 * np.nanmean(away):.3f} mm, max {1e3 * np.nanmax(away):.3f} mm"
    return text + (f", no answer for {lost} of {len(q)}" if lost else "")


def logged(folder: Path, metres: bool, name: str = "log.csv") -> tuple[calib.Samples, str]:
    """Make the log of a folder, and read it as `train` does."""
    scene = TagScene(7)
    if metres:
        lens, _ = load_lens(folder / "shots", BOARD)
        scene = TagScene(7, board=BOARD, lens=lens)
    made = log_pictures(folder / "pictures", read_joints(folder / "joints.csv"), scene)
    calib.write_log(made, folder / name)
    return calib.read_log(folder / name, joints=NAMES), f"{made.source['noise']:.2g} {made.unit}"


def main() -> None:
    """Run all."""
    options = typed(__doc__, pictures=58, video=30.0, folder=Path)
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as made:
        run(options.folder or Path(made), options.pictures, options.video)


def run(folder: Path, count: int, seconds: float) -> None:
    """Print the table."""
    shoot(folder / "still", DESK, count, 1)
    shoot(folder / "bumped", BUMPED, 40, 2)
    (folder / "arm.urdf").write_text(urdf())
    arm = calib.load_arm(folder / "arm.urdf")
    models = {}
    for metres in (False, True):
        what = "metres" if metres else "pixels"
        log, noise = logged(folder / "still", metres, f"{what}.csv")
        models[what] = calib.train(log)
        print(f"{what}, no URDF (noise {noise}): {judge(models[what], DESK)}")
        if metres:
            old = calib.train(calib.babble(arm, 20_000, seed=0), size=20)
            found = calib.adapt(old, log)
            print(f"{what}, wrong URDF, adapted: {judge(found.model, DESK)}")
            given = calib.train(calib.read_log(folder / "still" / f"{what}.csv", arm))
            print(f"{what}, trained with the URDF as prior: {judge(given, DESK)}")
    for what, model in models.items():
        later, _ = logged(folder / "bumped", what == "metres", f"{what}.csv")
        drift = calib.check(model, later)
        causes = "; ".join(c.words for c in drift.causes[:2])
        print(f"{what}, camera bumped, 40 pictures: score {drift.score:.2f}, {causes}")
        if what == "pixels":
            found = calib.adapt(model, later)
            print(f"{what}, adapted to the bump: {judge(found.model, BUMPED)}")
    if seconds:
        film(folder / "film", DESK, seconds, 3)
        lens, _ = load_lens(folder / "still" / "shots", BOARD)
        table = read_joints(folder / "film" / "joints.csv")
        scenes = {"pixels": TagScene(7), "metres": TagScene(7, board=BOARD, lens=lens)}
        for what, scene in scenes.items():
            shot = log_video(folder / "film" / "run.mp4", table, scene)
            off = 1e3 * abs(shot.source["time_offset"] - 1004.0)
            calib.write_log(shot, folder / "film" / f"{what}.csv")
            log = calib.read_log(folder / "film" / f"{what}.csv", joints=NAMES)
            print(
                f"{what}, video, {len(log)} rests, clocks off by {off:.1f} ms: "
                f"{judge(calib.train(log), DESK)}"
            )


if __name__ == "__main__":
    main()
