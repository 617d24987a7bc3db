"""Measure spatial bodies: held-out errors and coverage, new mountings, cameras, poses, speed.

    python benchmarks/spatial.py --data FOLDER [--part PART]
        [--series a,c] [--rows 0,300,100,30] [--draws 5] [--peer NAME=PYTHON] [--json FILE]

FOLDER holds full_a.csv and full_c.csv: six joints of a UR10 and what a laser tracker saw (Landgraf
et al., CASE 2021; their README names the source). Rows are held out in ten contiguous blocks, of
which `--draws` are taken in turn; 0 rows are all others. The UR10's URDF is example-robot-data's.
FILE keeps the figures that it has of other parts.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

import calib
from calib.body.fitting import fit_structure
from calib.body.spatial import structure_of, unknown_structure
from calib.use.geometry import fit_geometry
from calib.use.urdf import corrected_urdf

sys.path.insert(0, str(Path(__file__).parent))
from spatial_peer import against, peer
from spatial_simulated import (
    MM,
    UR10,
    Row,
    UpTo,
    distance,
    fit,
    measure_camera,
    measure_poses,
    measure_straight,
    spread,
)

PEER_ROWS = 1000
"""Rows, evenly spaced, that the other tool and calib learn from: geometry needs no more."""


def series(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Joints (n, 6) [rad] and positions (n, 3) [m] of a series."""
    table = np.loadtxt(folder / f"full_{name}.csv", delimiter=",", skiprows=1)
    return table[:, :6], table[:, 6:9]


def split(n: int, rows: int, draws: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows to learn from, and the contiguous block that is held out."""
    blocks = np.array_split(np.arange(n), 10)
    for draw in range(draws):
        held = blocks[2 * draw % 10]
        pool = np.setdiff1d(np.arange(n), held)
        if rows:
            pool = np.sort(np.random.default_rng(draw).choice(pool, rows, replace=False))
        yield pool, held


def summary(errors: list[np.ndarray], bounds: list[np.ndarray]) -> Row:
    """Errors [mm] and the share of them that the bound covers."""
    e, b = np.concatenate(errors), np.concatenate(bounds)
    return {
        "mean": round(MM * float(e.mean()), 4),
        "p95": round(MM * float(np.percentile(e, 95)), 4),
        "max": round(MM * float(e.max()), 3),
        "bound": round(MM * float(b.mean()), 3),
        "covered": round(100 * float((e <= b).mean()), 1),
        "blocks": [round(MM * float(part.mean()), 3) for part in errors],
    }


def measure_rows(args: argparse.Namespace) -> Iterator[Row]:
    """Held-out errors by number of rows, beside the nominal arm and geometry, on the same rows."""
    structure = structure_of(calib.load_arm(UR10))
    simpler = {"nominal": UpTo.of(structure, "frame"), "geometry": UpTo.of(structure, "chain")}
    for name in args.series:
        q, z = series(args.data, name)
        for rows in args.rows:
            errors, bounds, members = [], [], []
            beside: dict[str, list[np.ndarray]] = {name: [] for name in simpler}
            for learn, held in split(len(q), rows, args.draws):
                found = fit(structure, q[learn], z[learn])
                errors.append(distance(found.body, q[held], z[held]))
                bounds.append(found.body.bound(q[held]))
                members.append(found.body.member)
                for kind, other in simpler.items():
                    body = fit(other, q[learn], z[learn]).body
                    beside[kind].append(distance(body, q[held], z[held]))
            means = {
                kind: round(MM * float(np.concatenate(e).mean()), 4) for kind, e in beside.items()
            }
            out = {"series": name, "rows": rows, **summary(errors, bounds), "members": members}
            yield {**out, **means}


def measure_peer(args: argparse.Namespace) -> Iterator[Row]:
    """Held-out errors beside those of other tools, all from the same rows of the log."""
    if not args.peer:
        yield {"skipped": "give --peer NAME=PYTHON of the tools that are installed"}
        return
    arm = calib.load_arm(UR10)
    structure = structure_of(arm)
    for name in args.series:
        q, z = series(args.data, name)
        errors: dict[str, list[np.ndarray]] = {"calib": []} | {tool: [] for tool, _ in args.peer}
        said: dict[str, Row] = {}
        for learn, held in split(len(q), 0, args.draws):
            rows = learn[:: math.ceil(len(learn) / PEER_ROWS)]
            body = fit(structure, q[rows], z[rows]).body
            errors["calib"].append(distance(body, q[held], z[held]))
            for tool in args.peer:
                found, words = against(tool, arm, structure, (q[rows], z[rows]), q[held])
                errors[tool[0]].append(np.linalg.norm(found - z[held], axis=1))
                said[tool[0]] = words
        means = {tool: MM * float(np.concatenate(e).mean()) for tool, e in errors.items()}
        ratios = {tool: round(means["calib"] / mean, 3) for tool, mean in means.items()}
        found = {tool: round(mean, 4) for tool, mean in means.items()}
        yield {"series": name, "rows": len(rows), **found, "ratio": ratios, "said": said}


def measure_mount(args: argparse.Namespace) -> Iterator[Row]:
    """`calib.adapt` of a model of one series to a few rows of the other, which was mounted anew."""
    arm = calib.load_arm(UR10)
    logs = {
        name: replace(calib.read_log(args.data / f"full_{name}.csv", arm), orientation=None)
        for name in ("a", "c")
    }
    for old, new in (("a", "c"), ("c", "a")):
        log, n = logs[new], len(logs[new])
        model = calib.train(
            logs[old].take(np.arange(0, len(logs[old]), max(1, len(logs[old]) // 3000)))
        )
        for rows in (10, 30, 100):
            errors, bounds, answered = [], [], []
            for draw in range(args.draws):
                chosen = np.random.default_rng(draw).choice(n, rows, replace=False)
                rest = log.take(np.setdiff1d(np.arange(n), chosen)[::5])
                moved = calib.adapt(model, log.take(chosen)).model
                bound = moved.expected_error(rest.q)
                known = np.isfinite(bound)
                error = np.linalg.norm(moved.forward(rest.q) - rest.x, axis=1)
                errors.append(error[known])
                bounds.append(bound[known])
                answered.append(float(known.mean()))
            told = {"answered": round(100 * float(np.mean(answered)), 1)}
            yield {"from": old, "to": new, "rows": rows, **told, **summary(errors, bounds)}


def measure_unknown(args: argparse.Namespace) -> Iterator[Row]:
    """No URDF: a chain from random starts."""
    arm = calib.load_arm(UR10)
    for name in args.series:
        q, z = series(args.data, name)
        for rows in (30, 100):
            errors, bounds = [], []
            for learn, held in split(len(q), rows, args.draws):
                structure = unknown_structure(arm.joint_names, arm.revolute, spread(z[learn]))
                body = fit_structure(structure, q[learn], z[learn]).body
                errors.append(distance(body, q[held], z[held]))
                bounds.append(body.bound(q[held]))
            yield {"series": name, "rows": rows, **summary(errors, bounds)}


def measure_safe(args: argparse.Namespace) -> Iterator[Row]:
    """Never worse than the nominal arm with fitted frames, fitted alike, on the same rows."""
    structure = structure_of(calib.load_arm(UR10))
    nominal = UpTo.of(structure, "frame")
    for name in args.series:
        q, z = series(args.data, name)
        ratios: dict[int, list[float]] = {10: [], 15: [], 20: [], 30: [], 60: []}
        for draw in range(args.draws):
            rows = list(ratios)[draw % len(ratios)]
            ((learn, held),) = list(split(len(q), rows, draw + 1))[-1:]
            errors = [
                distance(fit(each, q[learn], z[learn]).body, q[held], z[held]).mean()
                for each in (structure, nominal)
            ]
            ratios[rows].append(float(errors[0] / errors[1]))
        worst = {rows: round(max(found), 3) for rows, found in ratios.items() if found}
        yield {"series": name, "draws": args.draws, "worst": worst}


def measure_urdf(args: argparse.Namespace) -> Iterator[Row]:
    """The URDF that `calib urdf` writes, beside the nominal one; frames of both are fitted."""
    arm = calib.load_arm(UR10)
    for name in args.series:
        q, z = series(args.data, name)
        ((learn, held),) = split(len(q), 1000, 1)
        log = calib.Samples(
            q[learn], z[learn], arm.joint_names, arm.lower, arm.upper, arm.revolute, arm=arm
        )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "new.urdf"
            path.write_text(corrected_urdf(fit_geometry(calib.train(log, size=5))))
            arms = {"nominal": arm, "mean": calib.load_arm(path)}
        out: Row = {"series": name, "rows": len(learn)}
        for kind, each in arms.items():
            body = fit(UpTo.of(structure_of(each), "frame"), q[learn], z[learn]).body
            out[kind] = round(MM * float(distance(body, q[held], z[held]).mean()), 4)
        yield out


def measure_time(args: argparse.Namespace) -> Iterator[Row]:
    """Processor time of fits."""
    structure = structure_of(calib.load_arm(UR10))
    for name in args.series:
        q, z = series(args.data, name)
        for rows in (2500, 12_000):
            if len(q) < 0.9 * rows:
                continue
            fit(structure, q[:200], z[:200])  # imports
            began = time.process_time()
            fit(structure, q[:rows], z[:rows])
            spent = round(time.process_time() - began, 2)
            yield {"series": name, "rows": len(q[:rows]), "seconds": spent}


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "rows": measure_rows,
    "peer": measure_peer,
    "mount": measure_mount,
    "urdf": measure_urdf,
    "unknown": measure_unknown,
    "safe": measure_safe,
    "straight": measure_straight,
    "camera": measure_camera,
    "poses": measure_poses,
    "time": measure_time,
}


def main() -> None:
    """Print a JSON line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--series", type=lambda text: text.split(","), default=["a", "c"])
    parser.add_argument(
        "--rows", type=lambda text: [int(n) for n in text.split(",")], default=[0, 300, 100, 30]
    )
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--peer", type=peer, action="append", help="see spatial_peer.py")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    lines = []
    with threadpool_limits(1):
        for part in args.part or PARTS:
            for row in PARTS[part](args):
                lines.append({"part": part, **row})
                print(json.dumps(lines[-1]), flush=True)
    if args.json:
        old = json.loads(args.json.read_text(encoding="utf-8")) if args.json.exists() else []
        kept = [line for line in old if line["part"] not in (args.part or PARTS)]
        text = ",\n".join(json.dumps(line) for line in kept + lines)
        args.json.write_text(f"[\n{text}\n]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
