"""Accuracy against what a user would otherwise take: tables of docs/accuracy.md, the README's row.

    python benchmarks/accuracy.py [--quick] [--only real|simulated] [--data FOLDER]

Needs scikit-learn.  FOLDER holds the laser-tracker logs series_a.csv and series_c.csv of a UR10
(Landgraf et al., CASE 2021); without it those rows are left out, with a note.
"""

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from tables import table, typed

import calib

JOINTS = ["shoulder_lift_joint", "elbow_joint"]
NOISES = (0.0, 1e-4, 1e-3)
SAMPLES = (1000, 5000, 20_000)
TESTS = 2000
SHOULDER = (0.0, 0.1273)  # [m], origin of the planar logs in the drawing's root frame


def nominal_errors(log: calib.Samples) -> Any:
    """Distances (n,) [m] of measured positions from where the UR10's URDF says that they are."""
    from spatial import UR10

    arm = calib.load_arm(UR10, joints=JOINTS, tip="wrist_1_link")
    return np.linalg.norm(arm.forward(log.q) - SHOULDER - log.x, axis=1)


def simulated(n: int, noise: float, quick: bool) -> list[dict[str, Any]]:
    """Every peer on the same rows of two_link, tested on the same exact points."""
    from peers import PEERS

    log = calib.babble(calib.load_arm("two_link"), n, seed=0, noise=noise)
    simulation = log.simulation
    assert simulation is not None
    q = simulation.draw(TESTS, np.random.default_rng(12345))
    x = simulation.exact(q)
    rows = []
    for kind in PEERS[:2] if quick else PEERS:
        try:
            rows.append(_one(kind, log, q, x))
        except ImportError as error:
            print(f"{kind.name} is left out: {error}", file=sys.stderr)
    return rows


def _one(kind: Any, log: Any, q: Any, x: Any) -> dict[str, Any]:
    peer = kind()
    peer.fit(log.q, log.x, log)
    forward = np.linalg.norm(peer.forward(q) - x, axis=1)
    inverse = np.linalg.norm(log.simulation.exact(peer.inverse(x, q)) - x, axis=1)
    return {
        "method": peer.name,
        "forward_mean_mm": 1e3 * float(np.nanmean(forward)),
        "forward_max_mm": 1e3 * float(np.nanmax(forward)),
        "inverse_mean_mm": 1e3 * float(np.nanmean(inverse)),
        "inverse_max_mm": 1e3 * float(np.nanmax(inverse)),
        "refused": int(np.count_nonzero(~np.isfinite(forward + inverse))),
    }


def measured(folder: Path, quick: bool) -> list[dict[str, Any]]:
    """Every peer on a real UR10: ten contiguous blocks, five of them held out in turn."""
    from peers import PEERS

    rows = []
    for series in ("c",) if quick else ("a", "c"):
        log = calib.read_log(folder / f"series_{series}.csv", joints=JOINTS)
        blocks = np.array_split(np.arange(len(log)), 10)[::2]
        splits = [
            (log.take(np.setdiff1d(np.arange(len(log)), held)), log.take(held)) for held in blocks
        ]
        rows.append(_row(series, len(log), "nominal URDF", 1e3 * nominal_errors(log)))
        for kind in PEERS:
            gaps = []
            try:
                for some, rest in splits:
                    peer = kind().fit_forward(some.q, some.x, some)
                    gaps.append(np.linalg.norm(peer.forward(rest.q) - rest.x, axis=1))
            except ImportError as error:
                print(f"{kind.name} is left out: {error}", file=sys.stderr)
                continue
            gap = 1e3 * np.concatenate(gaps)
            rows.append(_row(series, len(log), kind.name, gap))
    return rows


def _row(series: str, rows: int, method: str, gap: Any) -> dict[str, Any]:
    return {
        "series": series.upper(),
        "rows": rows,
        "method": method,
        "mean [mm]": float(gap.mean()),
        "max [mm]": float(gap.max()),
    }


def main() -> None:
    """Print the tables."""
    options = typed(__doc__, quick=False, only=("real", "simulated"), data=Path)
    warnings.simplefilter("ignore")
    if options.only != "simulated" and options.data is None:
        print("no --data: the real arm is left out", file=sys.stderr)
    elif options.only != "simulated":
        table("A real arm", measured(options.data, options.quick))
    if options.only != "real":
        for n in SAMPLES[:1] if options.quick else SAMPLES:
            for noise in NOISES[::2] if options.quick else NOISES:
                title = f"{n:,} samples, noise {1e3 * noise:g} mm"
                table(title, simulated(n, noise, options.quick))


if __name__ == "__main__":
    main()
