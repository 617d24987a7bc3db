"""Measure the figures that the README shows: accuracy, a real arm, time and memory.

    python benchmarks/headline.py [--data FOLDER] [--json FILE]

FOLDER holds the laser-tracker logs series_a.csv and series_c.csv of a UR10 (see
docs/accuracy.md for their source); without it those rows are left out, aloud.  Whole
processes are timed beside MiniSom's updates in the same run, because the speed of a
machine drifts: quote the ratio.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from measure import minisom_rate, process

import calib

RUNS = 5
PAPER = {"forward": (1.15, 1.26), "inverse": (0.31, 0.44)}


def accuracy() -> list[dict[str, Any]]:
    """Errors on two_link, 70x70, 20,000 samples, seed 0, at three noise levels."""
    arm = calib.load_arm("two_link")
    rows = []
    for noise in (0.0, 1e-4, 1e-3):
        model = calib.train(calib.babble(arm, 20_000, seed=0, noise=noise), size=70, seed=0)
        errors = model.about.errors["local"]
        joints = [errors["inverse"][name] for name in arm.joint_names]
        rows.append(
            {
                "noise_mm": 1e3 * noise,
                "forward_mean_mm": 1e3 * errors["forward"]["distance"]["mean"],
                "forward_max_mm": 1e3 * errors["forward"]["distance"]["max"],
                "inverse_mean_deg": float(np.rad2deg(max(j["mean"] for j in joints))),
                "inverse_max_deg": float(np.rad2deg(max(j["max"] for j in joints))),
            }
        )
    return rows


def real_arm(folder: Path) -> list[dict[str, Any]]:
    """Held-out error on the UR10's logs, beside the nominal URDF where it is at hand."""
    joints = ["shoulder_lift_joint", "elbow_joint"]
    urdf = nominal_urdf()
    rows = []
    for series in ("a", "c"):
        path = folder / f"series_{series}.csv"
        log = calib.read_log(path, joints=joints)
        model = calib.train(log)
        errors = model.about.errors["local"]["forward"]["distance"]
        row: dict[str, Any] = {
            "series": series.upper(),
            "rows": len(log),
            "learned_mean_mm": 1e3 * errors["mean"],
            "learned_p99_mm": 1e3 * errors["p99"],
            "seconds": model.seconds["total"],
        }
        if urdf is not None:
            arm = calib.load_arm(urdf, joints=joints, tip="wrist_1_link")
            # the log's origin is the shoulder
            shoulder = arm.plane.project(arm.points(log.q[:1])[:, 0])
            gap = np.linalg.norm(arm.forward(log.q) - shoulder - log.x, axis=1)
            row["nominal_mean_mm"] = 1e3 * float(gap.mean())
        rows.append(row)
    return rows


def nominal_urdf() -> Path | None:
    """The UR10's URDF of PyPI example-robot-data, if it is installed."""
    try:
        import pinocchio
    except ImportError:
        return None
    root = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"
    return next(root.rglob("ur10_robot.urdf"), None) if root.is_dir() else None


def processes() -> dict[str, Any]:
    """Whole-process times and peak memory, and MiniSom's updates in between."""
    rates: list[float] = []
    result: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        commands = {
            "train": ["train", "two_link", "--size", "70", "--samples", "20000"],
            "query inverse": ["query", "inverse", "two_link.calib", "0.3", "0.3"],
            "help": ["--help"],
        }
        for name, arguments in commands.items():
            seconds, memory = [], []
            for _ in range(RUNS):
                rates.append(minisom_rate())
                done = process([sys.executable, "-m", "calib_cli", *arguments], Path(folder))
                seconds.append(done.wall)
                memory.append(done.peak_mb)
            result[name] = {
                "seconds": statistics.median(seconds),
                "slowest": max(seconds),
                "peak_mb": max(memory),
            }
        result["model_file_mb"] = (Path(folder) / "two_link.calib").stat().st_size / 1e6
    if rates[0] > 0:
        rate = statistics.median(rates)
        result["minisom_updates_per_second"] = rate
        result["train_seconds_at_5000_updates"] = result["train"]["seconds"] * rate / 5000
    return result


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, help="folder with series_a.csv and series_c.csv")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    options = parser.parse_args()
    found: dict[str, Any] = {}
    if options.data is None:
        print("no --data: the real arm is left out", file=sys.stderr)
    else:
        found["real arm"] = real_arm(options.data)
        print("UR10, laser tracker; ten contiguous blocks, five held out in turn")
        for row in found["real arm"]:
            print("  " + ", ".join(f"{k} {v:.4g}" if k != "series" else v for k, v in row.items()))
    found["accuracy"] = accuracy()
    print("two_link, 70x70, 20,000 samples, against the true position")
    for row in found["accuracy"]:
        print("  " + ", ".join(f"{k} {v:.3g}" for k, v in row.items()))
    found["processes"] = processes()
    print("whole processes")
    for name, figures in found["processes"].items():
        print(f"  {name}: {json.dumps(figures)}")
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
