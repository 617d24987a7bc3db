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
from itertools import product
from pathlib import Path

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

from boards import SIZE, SPEC, Rig

BUMP = 3.0  # px
SERIES = 20  # pictures


def main() -> None:
    """Print a row for each kind of rig."""
    asked = typed(__doc__, worlds=60, so101=str, guard=False, plan=False)
    if asked.guard or asked.plan:
        (guard if asked.guard else planned)(asked.worlds)
        return
    names = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    more = {"robot": asked.so101, "joints": names, "off": 5.0, "pictures": 30}
    more = more if asked.so101 else {}
    print("| camera, lens | hand off by | covered, size | with the gauge | base off by |")
    print("|---|---|---|---|---|")
    for in_hand in (True, False):
        for known in (True, False):
            one(in_hand, known, asked.worlds, more)


def one(in_hand: bool, known: bool, worlds: int, more: dict) -> None:
    """Print the figures of one kind of rig."""
    rows, solvers = [], {}
    for seed in range(worlds):
        rig = Rig(in_hand, seed=seed, known=known, last=True, **more)
        shots = rig.shots()
        lens = rig.glass if known else None
        answer = calib.handeye(rig.arm, shots, eye=rig.eye, lens=lens)
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
            1e3 * np.linalg.norm(np.subtract(answer.base["position"], rig.base[0])),
        ])  # fmt: skip
        if known and not more:
            for name, miss in opencv(rig, true).items():
                solvers.setdefault(name, []).append(miss)
    mean = np.mean(rows, axis=0)
    where = "in the hand" if in_hand else "before the board"
    print(
        f"| {where}, {'known' if known else 'fitted'} | {mean[0]:.3f} mm, {mean[1]:.3f} deg | "
        f"{100 * mean[2]:.0f} %, ±{mean[4]:.2f} mm; {100 * mean[3]:.0f} %, ±{mean[5]:.3f} deg | "
        f"{100 * mean[6]:.0f} %, ±{mean[7]:.2f} mm | {mean[8]:.2f} mm |",
        flush=True,
    )
    for name, misses in solvers.items():
        far, turn = np.mean(misses, axis=0)
        print(f"| - OpenCV, {name} | {1e3 * far:.2f} mm, {np.degrees(turn):.3f} deg | | | |")


def opencv(rig: Rig, true: object) -> dict[str, tuple[float, float]]:
    """How far OpenCV's solvers are off [m, rad], which take the arm as it is drawn."""
    if not hasattr(cv2, "calibrateHandEye"):
        return {}
    base, neutral = rig.structure.with_sensor(view="base"), rig.structure.neutral()
    p, turn = base.pose(rig.q, neutral)
    seen = rig.shots().poses(rig.glass)
    there = hand_poses(seen, "base")
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
    return out


def planned(worlds: int) -> None:
    """Print how far what is in the hand is off by planned poses, and by random ones."""
    print("| camera in the hand, lens known | planned [mm] | random | planned less random |")
    for in_hand, known in product((True, False), repeat=2):
        misses = []
        for seed in range(worlds):
            rig = Rig(in_hand, seed=seed, known=known, noise=0.3)
            others, rng = rig.q, np.random.default_rng(seed)
            q = calib.plan(rig.arm, 24, handeye=SPEC, eye=rig.eye, start=rig.start[0]).q
            rig.look(q, rng)
            inside = ((rig.seen > 0) & (rig.seen < SIZE)).reshape(len(q), -1).all(axis=1)
            misses.append([miss(rig, q[inside], rng), miss(rig, others[: inside.sum()], rng)])
        plan, other = 1e3 * np.transpose(misses)
        more, sd = (plan - other).mean(), (plan - other).std() / worlds**0.5
        means = f"{plan.mean():.3f} | {other.mean():.3f} | {more:+.3f} ± {sd:.3f}"
        print(f"| {in_hand}, {known} | {means} |", flush=True)


def miss(rig: Rig, q: np.ndarray, rng: np.random.Generator) -> float:
    """How far what is in the hand is off [m] by pictures at joints that repeat to 1e-4 rad."""
    rig.look(q + 1e-4 * rng.standard_normal(q.shape), rng)
    rig.q = q
    return float(np.linalg.norm(rig.miss(rig.solve())[0]))


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
                log = shots.log(glass, rig.eye)
                log = replace(log, arm=own.poses.arm, source=own.poses.source)
                drifted = bool(calib.check(model, log).drifted)
                alarms += drifted and not bumped
                found += drifted and bumped
                series += not bumped
        print(f"{seed + 1}: {alarms} false alarms, {found} bumps found of {series}", flush=True)


if __name__ == "__main__":
    main()
