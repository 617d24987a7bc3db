"""Hand-eye calibration of arms that are off: how near, and whether the intervals hold.

    python benchmarks/handeye.py [--worlds 60] [--planned]

Corners of a board are projected by an arm of a known truth (joints off by up to 0.2 deg, origins by
up to 0.3 mm) with 0.1 px of noise, 24 pictures a world; the camera in the hand or before the board,
its lens known or fitted.  Offsets of the first and the last joint are left out: no picture tells
them from what stands still and from what is in the hand.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import process_time

import numpy as np

import calib
from calib.arm.rotations import logarithm
from calib.body.corners import fit_corners
from calib.body.sensor import SensorPose

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from boards import Rig


def planned(worlds: int) -> None:
    """How well planned pictures tell where the camera or board in the hand is, beside random ones.

    Planned on the drawing, for a camera that looks along the tip's axis: it truly is some 9 deg and
    70 mm off.  Pictures that do not show half of the corners are lost.
    """
    print("| camera | pictures | seen | hand [mm] | [deg] |")
    print("|---|---|---|---|---|")
    for in_hand in (True, False):
        for count, plan in ((40, False), (12, True), (12, False)):
            off, turned, seen = [], [], []
            for seed in range(worlds):
                rig, rng = Rig(in_hand, seed=seed, pictures=count), np.random.default_rng(seed)
                if plan:
                    eye, spec = "hand" if in_hand else "base", "7x5:24mm:18mm:5x5_100"
                    found = calib.plan(
                        rig.arm, count, handeye=spec, eye=eye, start=rig.start[0], seed=seed
                    )
                    rig.look(found.q, rng)
                inside = ((rig.seen > 0) & (rig.seen < (1280, 720))).all(axis=1)
                shown = (
                    np.bincount(rig.rows, inside, len(rig.q)) >= len(rig.corners) / len(rig.q) / 2
                )
                keep = inside & shown[rig.rows]
                rows = np.searchsorted(np.flatnonzero(shown), rig.rows[keep])
                _, body = fit_corners(
                    rig.structure, rig.q[shown], rig.poses[shown], rows, rig.corners[keep],
                    rig.seen[keep], in_hand,
                )  # fmt: skip
                (p, turn), (p0, turn0) = rig.hand(body.beta), rig.hand(rig.beta)
                off.append(np.linalg.norm(p - p0))
                turned.append(np.linalg.norm(logarithm((turn.T @ turn0)[None])))
                seen.append(shown.sum())
            print(
                f"| {'in the hand' if in_hand else 'before the board'} | "
                f"{count} {'planned' if plan else 'random'} | {np.mean(seen):.0f} | "
                f"{1e3 * np.mean(off):.2f} | {np.degrees(np.mean(turned)):.3f} |",
                flush=True,
            )


def main() -> None:
    """Print a row for each kind of rig."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--worlds", type=int, default=60)
    parser.add_argument("--planned", action="store_true", help="planned and random pictures alone")
    options = parser.parse_args()
    count = options.worlds
    if options.planned:
        planned(count)
        return
    print("| camera, lens | hand [mm] | [deg] | covered | interval [mm] | base [mm] | fit |")
    print("|---|---|---|---|---|---|---|")
    for in_hand in (True, False):
        for known in (True, False):
            off, turned, hits, size, base, seconds = [], [], [], [], [], []
            for seed in range(count):
                rig = Rig(in_hand, seed=seed, known=known)
                began = process_time()
                _, body = fit_corners(
                    rig.structure, rig.q, rig.poses, rig.rows, rig.corners, rig.seen, in_hand
                )
                seconds.append(process_time() - began)
                (p, turn), (p0, turn0) = rig.hand(body.beta), rig.hand(rig.beta)
                own = rig.structure.groups["tool"]
                half = 1.96 * body.kappa * body.deviations[own]
                off.append(np.linalg.norm(p - p0))
                turned.append(np.linalg.norm(logarithm((turn.T @ turn0)[None])))
                hits.append(np.abs(body.beta[own] - rig.beta[own]) < half)
                size.append(half.max())
                sensor = SensorPose.of(body)
                base.append(np.linalg.norm(sensor.position - rig.base[0]))
            where = "in the hand" if in_hand else "before the board"
            print(
                f"| {where}, {'known' if known else 'fitted'} | {1e3 * np.mean(off):.2f} | "
                f"{np.degrees(np.mean(turned)):.3f} | {100 * np.mean(hits):.0f} % | "
                f"{1e3 * np.mean(size):.1f} | {1e3 * np.mean(base):.2f} | "
                f"{np.mean(seconds):.1f} s |",
                flush=True,
            )


if __name__ == "__main__":
    main()
