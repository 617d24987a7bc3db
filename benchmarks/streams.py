"""A stream for life: tool on, tool off, tool on, a shorter link; error over samples.

    python benchmarks/streams.py [--quick] [--figure FILE] [--csv FILE]

Prints for each change when it was noticed, when a kept schema was recalled, and the mean
error of the delivered model on 2,000 exact points after so many samples; then over several
seeds the samples until a change is noticed and a schema recalled, and wrong recalls.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

import calib

NOISE = 1e-3
TOOL, SHORT = "tip.offset=0.05,0", "elbow.length=-20%"
LEGS = (
    ("as trained", (), 300),
    ("tool on", (TOOL,), 2500),
    ("tool off", (), 500),
    ("tool on again", (TOOL,), 500),
    ("link 20 % shorter", (SHORT,), 1200),
    ("as trained again", (), 300),
)
LOOKS = (5, 15, 20, 30, 50, 100, 300, 500, 1000, 2500)


def stream(base: calib.Model, quick: bool) -> list[dict[str, float | str]]:
    """Follow all legs; a row for each look."""
    arm = calib.load_arm("two_link")
    q = np.random.default_rng(3).uniform(arm.lower, arm.upper, (2000, 2))
    follower = calib.Follower(base, horizon=2000)
    rows: list[dict[str, float | str]] = []
    total = 0
    for leg, (name, changes, n) in enumerate(LEGS):
        n = min(n, 300) if quick else n
        samples = calib.babble(arm, n, seed=100 + leg, noise=NOISE, changes=changes)
        truth = calib.Simulation(arm, changes=changes).exact(q)
        noticed = recalled = None
        for k in range(0, n, 5):
            state = follower.update(samples.q[k : k + 5], samples.x[k : k + 5])
            noticed = noticed or (k + 5 if state.changed else None)
            recalled = recalled or (k + 5 if state.recalled else None)
            if k + 5 in LOOKS or k + 5 == n:
                model = follower.model
                error = np.linalg.norm(model.forward(q) - truth, axis=1)
                by_maps = np.linalg.norm(model.forward(q, "activity") - truth, axis=1)
                bound = model.expected_error(q)
                known = np.isfinite(error)
                rows.append(
                    {
                        "leg": name,
                        "samples": k + 5,
                        "total": total + k + 5,
                        "schema": state.schema,
                        "learning": float(state.learning),
                        "noticed": noticed or float("nan"),
                        "recalled": recalled or float("nan"),
                        "error [mm]": 1e3 * float(np.nanmean(error)),
                        "activity [mm]": 1e3 * float(np.nanmean(by_maps)),
                        "answered": float(known.mean()),
                        "covered": float(np.mean(error[known] <= bound[known])),
                    }
                )
        total += n
        last = rows[-1]
        print(
            f"{name:18s} noticed after {noticed or '-':>3}, recalled after {recalled or '-':>3}, "
            f"{last['schema']}; "
            + ", ".join(f"{r['samples']}: {r['error [mm]']:.3g}" for r in rows if r["leg"] == name)
            + " mm",
            flush=True,
        )
    return rows


def recalls(base: calib.Model, trials: int) -> None:
    """Samples until a kept schema is present again, over many changes back and forth."""
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 2000, seed=5, noise=NOISE, changes=(TOOL,))
    both = calib.keep(base, calib.train(log, size=base.motor.lattice.shape[0]), "tool on")
    follower = calib.Follower(both)
    waited, wrong = [], 0
    for trial in range(trials):
        changes, name = ((TOOL,), "tool on") if trial % 2 == 0 else ((), base.schema)
        samples = calib.babble(arm, 60, seed=1000 + trial, noise=NOISE, changes=changes)
        for k, (q, x) in enumerate(zip(samples.q, samples.x, strict=True)):
            state = follower.update(q, x)
            if state.recalled:
                waited.append(k + 1)
                wrong += state.schema != name
                break
        else:
            wrong += 1
    told = np.array(waited)
    print(
        f"recalled in {np.median(told):.0f} samples (median; most {told.max()}), "
        f"{wrong} of {trials} wrong"
    )
    for n in (5, 10, 20, 30):
        found = [
            calib.recognise(both, calib.babble(arm, n, seed=s, noise=NOISE, changes=c)).name == name
            for s in range(3000, 3000 + trials)
            for c, name in (((TOOL,), "tool on"), ((), base.schema))
        ]
        print(f"a log of {n} rows: {sum(found)} of {len(found)} recognised")


def draw(rows: list[dict[str, float | str]], path: Path) -> None:
    """Error over the samples of the whole stream."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    ax = figure.subplots()
    total = [float(r["total"]) for r in rows]
    ax.plot(total, [float(r["error [mm]"]) for r in rows], ".-", label="local", color="#1c7ed6")
    by_maps = [float(r["activity [mm]"]) for r in rows]
    ax.plot(total, by_maps, ".-", label="activity", color="#e8590c", alpha=0.7)
    start = 0.0
    for name in dict.fromkeys(str(r["leg"]) for r in rows):
        ax.axvline(start, color="#adb5bd", linewidth=0.7)
        ax.text(start + 15, 70, name, fontsize=7, rotation=90, va="top")
        start = max(float(r["total"]) for r in rows if r["leg"] == name)
    ax.set(yscale="log", xlabel="samples", ylabel="mean error [mm]", ylim=(5e-3, 100))
    ax.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=140)


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few samples: does it run?")
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    arm = calib.load_arm("two_link")
    n, side = (2000, 15) if options.quick else (20_000, 30)
    base = calib.train(calib.babble(arm, n, seed=0, noise=NOISE), size=side)
    rows = stream(base, options.quick)
    recalls(base, 6 if options.quick else 40)
    if options.csv:
        with options.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    if options.figure:
        draw(rows, options.figure)


if __name__ == "__main__":
    main()
