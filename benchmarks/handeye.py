"""Hand-eye calibration of arms that are off: how near, whether intervals hold, and the guard.

    python benchmarks/handeye.py [--worlds 60] [--so101 so101.urdf] [--guard]

Corners of a board are projected by an arm of a known truth (joints off by up to 0.2 deg, origins by
up to 0.3 mm) with 0.1 px of noise, 24 pictures a world; the camera in the hand or before the board,
its lens known or fitted.  `--so101` takes that arm, its five joints off by up to 5 deg, and 30
pictures.  Places in the hand are compared as the last joint's encoder says: a turn about its axis
and a shift along it are told by no picture.  OpenCV's solvers get the same corners where it has
them (4.x), with the lens known.  `--guard` counts false alarms of `check`, and cameras found that
were bumped by 3 px, in series of 20 pictures.
"""

import sys
from dataclasses import replace
from pathlib import Path
from time import process_time

import cv2
import numpy as np
from handeye_real import some
from tables import typed

import calib
from calib.arm.rotations import logarithm
from calib.body.sensor_pose import hand_pose
from calib.recording.board_pictures import hand_poses
from calib.samples.lens import Lens

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from boards import Rig

BUMP = 3.0  # px
SERIES = 20  # pictures


def main() -> None:
    """Print a row for each kind of rig."""
    asked = typed(__doc__, worlds=60, so101=str, guard=False)
    if asked.guard:
        guard(asked.worlds)
        return
    names = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    more = {"robot": asked.so101, "joints": names, "off": 5.0, "pictures": 30}
    more = more if asked.so101 else {}
    print("| camera, lens | hand off by | covered, size | with the gauge | base off by | fit |")
    print("|---|---|---|---|---|---|")
    for in_hand in (True, False):
        for known in (True, False):
            one(in_hand, known, asked.worlds, more)


def one(in_hand: bool, known: bool, worlds: int, more: dict) -> None:
    """Print the figures of one kind of rig."""
    rows, solvers = [], {}
    for seed in range(worlds):
        rig = Rig(in_hand, seed=seed, known=known, last=True, **more)
        began = process_time()
        shots = rig.shots()
        lens = rig.glass if known else None
        answer = calib.handeye(rig.arm, shots, eye=rig.eye, lens=lens)
        seconds = process_time() - began
        found, true = hand_pose(answer.body), hand_pose(replace(answer.body, beta=rig.beta))
        # the drawn tip's frame, with whatever the last joint is off by
        p, _ = rig.hand(rig.beta)
        off = found.position - true.position
        turned = logarithm((found.rotation @ true.rotation.T)[None])[0]
        hand = {name: np.array(value) for name, value in answer.hand.items()}
        rows.append([
            1e3 * np.linalg.norm(off), np.degrees(np.linalg.norm(turned)),
            np.mean(np.abs(off) < hand["position_95_up_to_gauge"]),
            np.mean(np.abs(turned) < hand["rotation_95_up_to_gauge"]),
            1e3 * hand["position_95_up_to_gauge"].max(),
            np.degrees(hand["rotation_95_up_to_gauge"].max()),
            np.mean(np.abs(found.position - p) < hand["position_95"]),
            1e3 * hand["position_95"].max(),
            1e3 * np.linalg.norm(np.subtract(answer.base["position"], rig.base[0])), seconds,
        ])  # fmt: skip
        if known and not more:
            for name, miss in opencv(rig, true).items():
                solvers.setdefault(name, []).append(miss)
    mean = np.mean(rows, axis=0)
    where = "in the hand" if in_hand else "before the board"
    print(
        f"| {where}, {'known' if known else 'fitted'} | {mean[0]:.3f} mm, {mean[1]:.3f} deg | "
        f"{100 * mean[2]:.0f} %, ±{mean[4]:.2f} mm; {100 * mean[3]:.0f} %, ±{mean[5]:.3f} deg | "
        f"{100 * mean[6]:.0f} %, ±{mean[7]:.2f} mm | {mean[8]:.2f} mm | {mean[9]:.1f} s |",
        flush=True,
    )
    for name, misses in solvers.items():
        far, turn = np.mean(misses, axis=0)
        print(f"| - OpenCV, {name} | {1e3 * far:.2f} mm, {np.degrees(turn):.3f} deg | | | | |")


def opencv(rig: Rig, true: object) -> dict[str, tuple[float, float]]:
    """How far OpenCV's solvers are off [m, rad], which take the arm as it is drawn."""
    if not hasattr(cv2, "calibrateHandEye"):
        return {}
    base, neutral = rig.structure.with_sensor(view="base"), rig.structure.neutral()
    p, turn = base.pose(rig.q, neutral)
    seen = rig.shots().poses(rig.glass)
    there = hand_poses(seen, in_hand=False)
    boards, shifts = there[:, :3, :3], there[:, :3, 3]
    out = {}
    kinds = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
    if not rig.in_hand:  # the base in the hand's frame takes the place of the hand in the base's
        turn = np.swapaxes(turn, 1, 2)
        p = -np.einsum("nij,nj->ni", turn, p)
    for kind in kinds:
        r, t = cv2.calibrateHandEye(
            list(turn), list(p), list(boards), list(shifts),
            method=getattr(cv2, f"CALIB_HAND_EYE_{kind}"),
        )  # fmt: skip
        if not rig.in_hand:  # what comes out is the camera in the base; the board follows from it
            first = np.swapaxes(turn[0], 0, 1)
            camera = r @ boards[0], r @ shifts[0] + t[:, 0]
            r, t = first.T @ camera[0], (first.T @ camera[1] + p[0])[:, None]
        off = float(np.linalg.norm(t[:, 0] - true.position))
        out[kind] = off, float(np.linalg.norm(logarithm((r @ true.rotation.T)[None])))
    inverse = np.swapaxes(turn, 1, 2)
    _, _, r, t = cv2.calibrateRobotWorldHandEye(
        list(boards), list(shifts), list(inverse), list(-np.einsum("nij,nj->ni", inverse, p))
    )
    if rig.in_hand:  # of the hand in the camera's frame
        off = float(np.linalg.norm(-r.T @ t[:, 0] - true.position))
        turned = float(np.linalg.norm(logarithm((r.T @ true.rotation.T)[None])))
        out["robot-world, SHAH"] = off, turned
    return out


def guard(worlds: int) -> None:
    """Print how often `check` calls a camera bumped that was not, and finds one that was."""
    alarms, found, series = 0, 0, 0
    for seed in range(worlds):
        rig = Rig(seed % 2 == 0, seed=seed, pictures=24 + 2 * SERIES)
        lens = rig.glass if seed % 4 < 2 else None
        eye = rig.eye
        own = calib.handeye(rig.arm, some(rig.shots(), np.arange(24)), eye=eye, lens=lens)
        model, glass = calib.train(own.poses), Lens.from_json(own.poses.source["lens"])
        late = rig.beta.copy()
        what = "tool.rotation" if rig.in_hand else "view.rotation"
        away = np.random.default_rng(seed).standard_normal(2)
        away = BUMP / rig.lens[0] * away / np.linalg.norm(away)
        late[rig.structure.groups[what][:2]] += away
        moved = rig.as_seen(late) - rig.as_seen(rig.beta)
        for bumped in (False, True):
            for first in (24, 24 + SERIES):
                series_rows = np.arange(first, first + SERIES)
                shots = some(rig.shots(rig.seen + bumped * moved), series_rows)
                log = shots.log(glass, rig.in_hand)
                log = replace(log, arm=own.poses.arm, source=own.poses.source)
                drifted = bool(calib.check(model, log).drifted)
                alarms += drifted and not bumped
                found += drifted and bumped
                series += not bumped
        print(f"{seed + 1}: {alarms} false alarms, {found} bumps found of {series}", flush=True)


if __name__ == "__main__":
    main()
