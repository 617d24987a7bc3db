"""Measure drift detection and re-calibration: the tables of docs/drift.md.

    python benchmarks/adaptation.py [--quick] [--data FOLDER] [--only PART ...]

PART is one of detection, few-shot, online, real.  FOLDER holds the laser-tracker
logs series_a.csv and series_c.csv of a UR10 (docs/accuracy.md names their source); the
nominal URDF is that of PyPI example-robot-data.  Without them the real arm is left out,
aloud.  All figures are in mm and come from fixed seeds.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from honest_real import JOINTS, nominal_urdf
from tables import table

import calib
from calib.stream.follow import follow

Array = Any

DETECTED = {
    "no change": [],
    "noise doubled": [],
    "shoulder link +5 %": ["shoulder.length=+5%"],
    "shoulder link -5 %": ["shoulder.length=-5%"],
    "elbow link +5 %": ["elbow.length=+5%"],
    "elbow link -5 %": ["elbow.length=-5%"],
    "shoulder encoder 1 deg": ["shoulder.offset=0.0174533"],
    "elbow encoder 1 deg": ["elbow.offset=0.0174533"],
    "camera turned 1 deg": ["sensor.rotate=0.0174533"],
    "camera mirrored": ["sensor.mirror=x"],
    "elbow link -20 %": ["elbow.length=-20%"],
    "elbow locked": ["elbow.lock=1.0"],
}
CHANGED = {
    "elbow link +20 %": ["elbow.length=+20%"],
    "links -10 %, -20 %": ["shoulder.length=-10%", "elbow.length=-20%"],
    "camera 8 deg, 30 mm, 1.05": [
        "sensor.rotate=0.139626",
        "sensor.shift=0.03,0",
        "sensor.scale=1.05",
    ],
    "encoders 3, -2 deg": ["shoulder.offset=0.0523599", "elbow.offset=-0.0349066"],
    "mirrored camera": ["sensor.mirror=x"],
    "lens distortion": [],
}
T95 = {1: np.nan, 2: 12.71, 10: 2.26}  # Student's t for so many blocks


def trained(noise: float) -> calib.Model:
    """The model that everything starts from: two_link, 70x70, 20,000 samples, seed 0."""
    arm = calib.load_arm("two_link")
    return calib.train(calib.babble(arm, 20_000, seed=0, noise=noise), size=70)


def detection(quick: bool) -> list[dict[str, Any]]:
    """Share of seeds in which 200 new samples at 1 mm noise are said to have drifted."""
    arm, model = calib.load_arm("two_link"), trained(1e-3)
    rows = []
    for name, changes in DETECTED.items():
        seeds = range(10 if quick else 100)
        noise = 2e-3 if name == "noise doubled" else 1e-3
        found = [
            calib.check(model, calib.babble(arm, 200, seed=1000 + s, noise=noise, changes=changes))
            for s in seeds
        ]
        causes = dict(Counter(cause.cause for drift in found for cause in drift.causes))
        rows.append(
            {
                "change": name,
                "drifted": sum(bool(d.drifted) for d in found),
                "of": len(found),
                "least score": min(d.score for d in found),
                "causes": causes,
            }
        )
    return rows


def lens(x: Array) -> Array:
    """Barrel distortion about a point inside of the workspace, 10 % per 0.35 m squared."""
    away = x - np.array([0.2, 0.25])
    return np.asarray(x + 0.8 * np.sum(away**2, axis=1, keepdims=True) * away)


def few_shot(quick: bool) -> list[dict[str, Any]]:
    """Mean error over the workspace before and after, of the adapted model itself."""
    arm, model = calib.load_arm("two_link"), trained(0.0)
    q = np.random.default_rng(9).uniform(arm.lower, arm.upper, (3000, 2))
    cases = {
        "30 exact": (30, 0.0, 0.0),
        "100 exact": (100, 0.0, 0.0),
        "100, 1 mm": (100, 1e-3, 0.0),
        "100, 1 mm, 5 % outliers": (100, 1e-3, 0.05),
    }
    rows = []
    for name, changes in CHANGED.items():
        seen = lens if name == "lens distortion" else (lambda x: x)
        row: dict[str, Any] = {"change": name}
        for case, (n, noise, share) in cases.items():
            errors, scratch = [], []
            for seed in range(2 if quick else 5):
                log = calib.babble(arm, n, seed=300 + seed, changes=changes)
                truth = seen(log.simulation.exact(q))
                row["before"] = 1e3 * _distance(model.forward(q), truth)
                rng = np.random.default_rng(seed)
                x = seen(log.x) + noise * rng.standard_normal(log.x.shape)
                wrong = rng.random(n) < share
                low, high = truth.min(axis=0), truth.max(axis=0)
                x[wrong] = rng.uniform(low, high, (n, 2))[wrong]
                log = replace(log, x=x, simulation=None)
                adapted = calib.adapt(model, log).model
                errors.append(1e3 * _distance(adapted.forward(q), truth))
                if case == "100, 1 mm" and seed < 2:  # the slow part: folds are trained too
                    alone = calib.train(log, size=10)
                    scratch.append(1e3 * _distance(alone.forward(q), truth))
            row[case] = float(np.mean(errors))
            row[f"{case}, worst seed"] = float(np.max(errors))
            if scratch:
                row[f"{case}, from scratch"] = float(np.mean(scratch))
        rows.append(row)
    return rows


def _distance(said: Array, truth: Array) -> float:
    return float(np.nanmean(np.linalg.norm(said - truth, axis=1)))


def online(quick: bool) -> list[dict[str, Any]]:
    """Errors before and after a stream, beside a map trained afresh on 20,000 samples."""
    arm, model = calib.load_arm("two_link"), trained(0.0)
    q = np.random.default_rng(9).uniform(arm.lower, arm.upper, (3000, 2))
    rows = []
    for share in ("+20%", "-20%"):
        change = f"elbow.length={share}"
        stream = calib.babble(arm, 5_000 if quick else 12_000, seed=7, changes=[change])
        truth = stream.simulation.exact(q)
        horizon = 4_000 if quick else 10_000
        settled = None
        noticed = False
        steps = list(follow(model, stream.q, stream.x, horizon=horizon))
        for step, _ in steps:
            noticed = noticed or step.adapting
            below = noticed and step.zeta_sensory < step.threshold
            settled = (settled or step.samples) if below else None
        step, adapter = steps[-1]
        followed = adapter.model()
        fresh = calib.train(calib.babble(arm, 20_000, seed=1, changes=[change]), size=70)
        row: dict[str, Any] = {
            "change": change,
            "samples": len(stream),
            "zeta": step.zeta_sensory,
            "threshold": step.threshold,
            "below the threshold since": settled,
        }
        for readout in ("local", "activity", "winner"):
            for what, one in (("before", model), ("after", followed), ("fresh", fresh)):
                row[f"{readout} {what}"] = 1e3 * _distance(one.forward(q, readout), truth)
        rows.append(row)
    return rows


def _half(values: Array) -> float:
    """Half of the 95 % interval of a mean."""
    return float(T95[len(values)] * np.std(values, ddof=1) / np.sqrt(len(values)))


def real_arm(folder: Path, quick: bool) -> list[dict[str, Any]]:
    """UR10, ten contiguous blocks, each held out once; nominal URDF adapted on the others."""
    rows = []
    for series in ("c", "a"):
        path = folder / f"series_{series}.csv"
        free = calib.read_log(path, joints=JOINTS)
        ranges = {
            name: (float(low) - 1e-6, float(high) + 1e-6)
            for name, low, high in zip(JOINTS, free.lower, free.upper, strict=True)
        }
        arm = calib.load_arm(nominal_urdf(), joints=JOINTS, tip="wrist_1_link", ranges=ranges)
        log = calib.read_log(path, arm)
        model = calib.train(calib.babble(arm, 20_000, seed=0), size=70)
        blocks = np.array_split(np.arange(len(log)), 10)
        for n in (100, 1500, None):
            urdf, alone, seconds = [], [], 0.0
            for k, held in enumerate(blocks[:: 5 if quick else 1]):
                others = np.setdiff1d(np.arange(len(log)), held)
                if n is not None:
                    others = np.sort(np.random.default_rng(k).permutation(others)[:n])
                part = log.take(others)
                start = time.perf_counter()
                adapted = calib.adapt(model, part).model
                seconds += time.perf_counter() - start
                urdf.append(1e3 * _distance(adapted.forward(log.q[held]), log.x[held]))
                scratch = calib.train(part)
                alone.append(1e3 * _distance(scratch.forward(log.q[held]), log.x[held]))
            gain = np.array(alone) - np.array(urdf)
            rows.append(
                {
                    "series": series.upper(),
                    "rows": n or f"all ({len(log) * 9 // 10})",
                    "adapted": float(np.mean(urdf)),
                    "interval": _half(urdf),
                    "log alone": float(np.mean(alone)),
                    "gain": float(gain.mean()),
                    "gain interval": _half(gain),
                    "seconds": seconds / len(urdf),
                }
            )
    return rows


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer seeds and blocks")
    parser.add_argument("--data", type=Path, help="folder with series_a.csv and series_c.csv")
    parser.add_argument("--only", nargs="+", default=[], help="parts to run")
    options = parser.parse_args()
    parts: dict[str, Callable[[bool], list[dict[str, Any]]]]
    parts = {"detection": detection, "few-shot": few_shot, "online": online}
    if options.data is not None:
        parts["real"] = lambda quick: real_arm(options.data, quick)
    else:
        print("no --data: the real arm is left out", file=sys.stderr)
    for name in options.only or parts:
        table(name, parts[name](options.quick))


if __name__ == "__main__":
    main()
