"""Accuracy against what a user would otherwise take; writes docs/accuracy.md and .json.

    python benchmarks/accuracy.py [--quick] [--page] [--data FOLDER] [--out FOLDER]

--page writes the page of the figures that accuracy.json and spatial.json of --out have.  Needs
scikit-learn and minisom.  FOLDER of --data holds the laser-tracker logs series_a.csv and
series_c.csv of a UR10; without it those rows are left out, with a note.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from spatial_page import section

import calib

ROOT = Path(__file__).parent.parent
DATA = ROOT.parent / "shared" / "data" / "ur10_laser_tracker"
JOINTS = ["shoulder_lift_joint", "elbow_joint"]
NOISES = (0.0, 1e-4, 1e-3)
SAMPLES = (1000, 5000, 20_000)
TESTS = 2000


def simulated(quick: bool) -> list[dict[str, Any]]:
    """Every peer on the same rows of two_link, tested on the same exact points."""
    from peers import PEERS, SLOW

    rows = []
    for n in SAMPLES[:1] if quick else SAMPLES:
        for noise in NOISES[::2] if quick else NOISES:
            log = calib.babble(calib.load_arm("two_link"), n, seed=0, noise=noise)
            simulation = log.simulation
            assert simulation is not None
            q = simulation.draw(TESTS, np.random.default_rng(12345))
            x = simulation.exact(q)
            slow = SLOW if n == SAMPLES[-1] and noise in NOISES[::2] else ()
            for kind in (*PEERS, *slow):
                rows.append({"samples": n, "noise_mm": 1e3 * noise} | _one(kind, log, q, x))
                _say(rows[-1])
    return rows


def _one(kind: Any, log: Any, q: Any, x: Any) -> dict[str, Any]:
    peer = kind()
    start = time.perf_counter()
    peer.fit(log.q, log.x, log)
    trained = time.perf_counter()
    forward = np.linalg.norm(peer.forward(q) - x, axis=1)
    between = time.perf_counter()
    answer = peer.inverse(x, q)
    done = time.perf_counter()
    inverse = np.linalg.norm(log.simulation.exact(answer) - x, axis=1)
    return {
        "peer": peer.name,
        "note": peer.note,
        "forward_mean_mm": 1e3 * float(np.nanmean(forward)),
        "forward_max_mm": 1e3 * float(np.nanmax(forward)),
        "inverse_mean_mm": 1e3 * float(np.nanmean(inverse)),
        "inverse_max_mm": 1e3 * float(np.nanmax(inverse)),
        "unanswered": int(np.count_nonzero(~np.isfinite(forward + inverse))),
        "train_s": trained - start,
        "forward_us": 1e6 * (between - trained) / len(q),
        "inverse_us": 1e6 * (done - between) / len(q),
        "size_kb": peer.size() / 1e3,
    }


def measured(folder: Path, quick: bool) -> list[dict[str, Any]]:
    """Every peer on a real UR10: ten contiguous blocks, five of them held out in turn."""
    from peers import Calib, Gaussian, Neighbours, Perceptron, Polynomial, Radial, Refit

    rows = []
    for series in ("c",) if quick else ("a", "c"):
        path = folder / f"series_{series}.csv"
        log = calib.read_log(path, joints=JOINTS)
        folds = np.array_split(np.arange(len(log)), 10)[::2]
        for kind in (Calib, Refit, Gaussian, Polynomial, Perceptron, Radial, Neighbours):
            errors, spent = [], 0.0
            start = time.perf_counter()
            if kind is Calib:
                model = calib.train(log)
                found = model.about.errors["local"]["forward"]["distance"]
                errors = [found["mean"]]
                worst = found["max"]
            else:
                gaps = []
                for held in folds:
                    others = np.setdiff1d(np.arange(len(log)), held)
                    peer = kind().fit_forward(log.q[others], log.x[others])
                    gaps.append(np.linalg.norm(peer.forward(log.q[held]) - log.x[held], axis=1))
                gap = np.concatenate(gaps)
                errors, worst = [float(gap.mean())], float(gap.max())
            spent = time.perf_counter() - start
            rows.append(
                {
                    "series": series.upper(),
                    "rows": len(log),
                    "peer": kind.name,
                    "mean_mm": 1e3 * errors[0],
                    "max_mm": 1e3 * worst,
                    "seconds": spent,
                }
            )
            _say(rows[-1])
    return rows


def _say(row: dict[str, Any]) -> None:
    print(json.dumps(row), file=sys.stderr)


def _number(value: float) -> str:
    if value < 1e-6:
        return "< 1e-6"
    return f"{value:.{max(0, 2 - math.floor(math.log10(value)))}f}"


def page(
    real: list[dict[str, Any]], rows: list[dict[str, Any]], spatial: list[dict[str, Any]]
) -> str:
    """The table as a page in Markdown."""
    lines = [
        "# Accuracy",
        "",
        "Written by `python benchmarks/accuracy.py`; edit that, not this page.",
        "",
        "## A real arm",
        "",
    ]
    if real:
        lines += [
            "UR10, two joints, measured with a laser tracker (Landgraf et al., CASE 2021; "
            "repository `christianlandgraf/ipa-robot-accuracy`, MIT).  Mean distance between "
            "prediction and measurement on rows that were not learned from: ten contiguous "
            "blocks, five of them held out in turn.",
            "",
            "| series | rows | method | mean [mm] | max [mm] |",
            "|---|---:|---|---:|---:|",
        ]
        lines += [
            f"| {r['series']} | {r['rows']:,} | {r['peer']} | {_number(r['mean_mm'])} | "
            f"{_number(r['max_mm'])} |"
            for r in real
        ]
    else:
        lines.append("The logs were not at hand when this page was written.")
    lines += ["", *section(spatial)] if spatial else [""]
    lines += [
        "## A simulated arm",
        "",
        f"`two_link`, the same rows for all, {TESTS:,} exact test points.  Noise is that of the "
        "sensor along each axis.  Inverse: distance from the target to where the answered joints "
        'really lead.  "Refused": test points whose error bound exceeds a tenth of the reach, '
        "left out of its errors.  Without noise calib and the refitted kinematic model find the "
        "arm exactly, since it is in their model class: nothing is lost on the way, but no real "
        "arm is so precise.  The refitted model is given the chain of the URDF; calib's body "
        "finds it from the rows.",
        "",
    ]
    lines += [f"- {r['peer']}: {r['note']}" for r in {r["peer"]: r for r in rows}.values()]
    head = (
        "| method | forward mean [mm] | max | inverse mean [mm] | max | training [s] | "
        "forward [us] | inverse [us] | size [kB] |"
    )
    keys = ("forward_mean_mm", "forward_max_mm", "inverse_mean_mm", "inverse_max_mm")
    keys += ("train_s", "forward_us", "inverse_us", "size_kb")
    for n in sorted({r["samples"] for r in rows}):
        for noise in sorted({r["noise_mm"] for r in rows}):
            lines += ["", f"### {n:,} samples, noise {noise:g} mm", "", head, "|---|" + "---:|" * 8]
            for r in rows:
                if (r["samples"], r["noise_mm"]) == (n, noise):
                    cells = " | ".join(_number(r[k]) for k in keys)
                    note = f" ({r['unanswered']} refused)" if r["unanswered"] else ""
                    lines.append(f"| {r['peer']}{note} | {cells} |")
    lines += ["", "Times are of one sitting on two busy cores: compare rows, not machines.", ""]
    return "\n".join(lines)


def main() -> None:
    """Run everything and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few samples: does it all run?")
    parser.add_argument("--page", action="store_true", help="write the page again, measure nothing")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--out", type=Path, default=ROOT / "docs")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    options.out.mkdir(parents=True, exist_ok=True)
    figures, space = options.out / "accuracy.json", options.out / "spatial.json"
    if not options.page:
        measure(options.data, figures, options.quick)
    kept = json.loads(figures.read_text())
    spatial = json.loads(space.read_text()) if space.exists() else []
    (options.out / "accuracy.md").write_text(page(kept["real"], kept["simulated"], spatial))


def measure(data: Path, target: Path, quick: bool) -> None:
    """Measure everything but arms in space and write the figures."""
    real: list[dict[str, Any]] = []
    if (data / "series_a.csv").exists():
        real = measured(data, quick)
    else:
        print(f"{data.name}: no logs there, the real arm is left out", file=sys.stderr)
    result = {"real": real, "simulated": simulated(quick), "quick": quick}
    target.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
