"""Measure spatial bodies: held-out errors and coverage, new mountings, cameras, poses, speed.

    python benchmarks/spatial.py --data FOLDER [--part PART]
        [--series a,c] [--rows 0,300,100,30] [--draws 5] [--json FILE]

FOLDER holds full_a.csv and full_c.csv: six joints of a UR10 and what a laser tracker saw (Landgraf
et al., CASE 2021; their README names the source). Rows are held out in ten contiguous blocks, of
which `--draws` are taken in turn; 0 rows are all others. The UR10's URDF is example-robot-data's.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
from threadpoolctl import threadpool_limits

import calib
from calib.arm.rotations import logarithm
from calib.body import Body
from calib.body.fitting import BodyFit, fit_structure
from calib.body.remount import remount
from calib.body.spatial import SpatialStructure, structure_of
from calib.body.spatial_random import unknown_structure
from calib.body.spatial_words import camera_place
from calib.inverse.pose import Joints, pose_branches

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from closed_form import closed_form

ROBOTS = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"
UR10 = ROBOTS / "ur_description/urdf/ur10_robot.urdf"
SO101 = ROBOTS / "so_arm_description/urdf/so101.urdf"
MM = 1e3

Row = dict[str, Any]


def series(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Joints (n, 6) [rad] and positions (n, 3) [m] of a series."""
    table = np.loadtxt(folder / f"full_{name}.csv", delimiter=",", skiprows=1)
    return table[:, :6], table[:, 6:9]


def spread(z: np.ndarray) -> float:
    """Rms distance of rows from their mean."""
    return float(np.sqrt(((z - z.mean(axis=0)) ** 2).sum(axis=1).mean()))


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


@dataclass(frozen=True)
class UpTo(SpatialStructure):
    """A structure whose gate goes no further than one member: "frame" is the nominal arm."""

    last: str = "chain"

    @classmethod
    def of(cls, structure: SpatialStructure, last: str) -> UpTo:
        """Return the same structure with fewer members."""
        own = {f.name: getattr(structure, f.name) for f in fields(structure)}
        return cls(**own, last=last)

    def members(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """The gate's members from simple to rich, up to the last."""
        names = [name for name, _ in super().members()]
        return super().members()[: names.index(self.last) + 1]


def fit(structure: SpatialStructure, q: np.ndarray, z: np.ndarray) -> BodyFit:
    """Fit a structure whose extent is that of the rows."""
    return fit_structure(replace(structure, extent=spread(z)), q, z)


def distance(body: Body, q: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Distances (n,) of rows from what a body predicts."""
    return np.linalg.norm(body.structure.residual(z, body.predict(q)), axis=1)


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


def measure_mount(args: argparse.Namespace) -> Iterator[Row]:
    """A body of one series, and a few rows of the other, which was mounted anew."""
    structure = structure_of(calib.load_arm(UR10))
    for old, new in (("a", "c"), ("c", "a")):
        q, z = series(args.data, old)
        every = max(1, len(q) // 3000)
        body = fit(structure, q[::every], z[::every]).body
        q, z = series(args.data, new)
        for rows in (10, 30, 100):
            errors, bounds = [], []
            for draw in range(args.draws):
                chosen = np.random.default_rng(draw).choice(len(q), rows, replace=False)
                rest = np.setdiff1d(np.arange(len(q)), chosen)[::5]
                moved = remount(body, q[chosen], z[chosen])
                errors.append(distance(moved, q[rest], z[rest]))
                bounds.append(moved.bound(q[rest]))
            yield {"from": old, "to": new, "rows": rows, **summary(errors, bounds)}


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
    """Never worse than the nominal arm with fitted frames; little worse than geometry alone."""
    structure = structure_of(calib.load_arm(UR10))
    for name in args.series:
        q, z = series(args.data, name)
        ratios = []
        for draw in range(args.draws):
            rows = (10, 20, 30, 60)[draw % 4]
            ((learn, held),) = list(split(len(q), rows, draw + 1))[-1:]
            body = fit(structure, q[learn], z[learn]).body
            plain = _nominal(structure, q[learn], z[learn])
            ratios.append(
                float(distance(body, q[held], z[held]).mean())
                / float(np.linalg.norm(plain(q[held]) - z[held], axis=1).mean())
            )
        yield {"series": name, "draws": args.draws, "worst": round(max(ratios), 3)}


def _nominal(
    structure: SpatialStructure, q: np.ndarray, z: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """The nominal arm with the frames that fit rows best."""
    from calib.body.spatial_start import frame

    beta = frame(structure, q, z)
    return lambda q: structure.predict(q, beta)


def measure_straight(args: argparse.Namespace) -> Iterator[Row]:
    """A simulated arm without joint curves: what the gate takes, against geometry alone."""
    arm = calib.load_arm(UR10)
    structure = structure_of(arm)
    for noise in (5e-5, 1e-3):
        for rows in (30, 100):
            ratios = []
            for draw in range(args.draws):
                rng = np.random.default_rng(draw)
                beta = structure.neutral()
                beta[structure.layout.shifts[1:]] = rng.normal(0, 1e-3, (5, 3))
                beta[structure.layout.turns[1:]] = rng.normal(0, 2e-3, (5, 3))
                q, fresh = (rng.uniform(arm.lower, arm.upper, (n, 6)) for n in (rows, 500))
                z = structure.predict(q, beta) + rng.normal(0, noise, (rows, 3))
                true = structure.predict(fresh, beta)
                both = [
                    structure,
                    _Geometry(**{f: getattr(structure, f) for f in structure.__dataclass_fields__}),
                ]
                errors = [distance(fit(each, q, z).body, fresh, true).mean() for each in both]
                ratios.append(float(errors[0] / errors[1]))
            yield {
                "noise_mm": MM * noise,
                "rows": rows,
                "ratio": round(float(np.mean(ratios)), 3),
                "worst": round(max(ratios), 3),
            }


class _Geometry(SpatialStructure):
    """The same structure, of which the gate knows frames and placements only."""

    def members(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Frames, then placements."""
        return tuple(each for each in super().members() if each[0] in ("frame", "chain"))


def measure_camera(args: argparse.Namespace) -> Iterator[Row]:
    """A simulated SO-101 in 60 pictures of an unknown camera, 0.3 px."""
    for exact in (True, False):
        for seed in range(args.draws):
            yield _camera(seed, exact)


def _camera(seed: int, exact: bool) -> Row:
    arm = calib.load_arm(SO101)
    structure = structure_of(arm, "pinhole", unit="px")
    rng, groups, layout = np.random.default_rng(seed), structure.groups, structure.layout
    beta = structure.neutral()
    beta[groups["offset"][1:]] = np.deg2rad(rng.uniform(-5, 5, arm.dof - 1))
    if not exact:
        beta[layout.shifts[1:]] = rng.normal(0, 1e-3, (arm.dof - 1, 3))
        beta[layout.turns[1:]] = np.deg2rad(rng.normal(0, 0.2, (arm.dof - 1, 3)))
        beta[groups["tool"]] = rng.normal(0, 2e-3, 3)
    eye, ahead = np.array([0.15, -0.75, 0.35]) + rng.normal(0, 0.05, 3), np.array([0.15, 0, 0.12])
    z = (ahead - eye) / np.linalg.norm(ahead - eye)
    x = np.cross(z, (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(z, x), z])
    beta[groups["view.rotation"]], beta[groups["view.shift"]] = logarithm(turn), -turn @ eye
    middle = (640 + rng.normal(0, 8), 360 + rng.normal(0, 8))
    beta[groups["lens"]] = (900 * rng.uniform(0.9, 1.1), *middle, -0.1 + rng.normal(0, 0.05))

    def seen(n: int) -> np.ndarray:
        rows: list[np.ndarray] = []
        while len(rows) < n:
            q = rng.uniform(arm.lower, arm.upper, (200, arm.dof))
            place, pixels = structure.pose(q, beta)[0], structure.predict(q, beta)
            depth = (place @ turn.T - turn @ eye)[:, 2]
            inside = ((pixels > 20) & (pixels < (1260, 700))).all(axis=1)
            rows += list(q[inside & (place[:, 2] > 0.02) & (depth > 0.2)])
        return np.array(rows[:n])

    q, fresh = seen(60), seen(1000)
    pixels = structure.predict(q, beta) + rng.normal(0, 0.3, (60, 2))
    body = fit(structure, q, pixels).body
    error = np.linalg.norm(body.predict(fresh) - structure.predict(fresh, beta), axis=1)
    bound = body.bound(fresh, noise=False)
    found, true = structure.pose(fresh, body.beta)[0], structure.pose(fresh, beta)[0]
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    scale = s.sum() / (a**2).sum()
    up_to = np.linalg.norm(b - scale * a @ (u @ vt).T, axis=1)
    place, frame = camera_place(structure, body.beta)
    return {
        "placements": "exact" if exact else "off by 1 mm, 0.2 deg",
        "seed": seed,
        "member": body.member,
        "pixels": round(float(error.mean()), 3),
        "covered": round(100 * float((error <= bound).mean()), 1),
        "tip_mm": round(MM * float(np.linalg.norm(found - true, axis=1).mean()), 3),
        "tip_up_to_similarity_mm": round(MM * float(up_to.mean()), 3),
        "camera_mm": round(MM * float(np.linalg.norm(place - eye)), 2),
        "camera_deg": round(float(np.degrees(np.linalg.norm(logarithm(frame @ turn)))), 3),
    }


def measure_poses(args: argparse.Namespace) -> Iterator[Row]:
    """Branches of the bundled six-axis arm against its closed form."""
    arm = calib.load_arm("six_axis")
    joints = Joints(arm.lower, arm.upper, arm.revolute)
    rng = np.random.default_rng(0)
    known = missed = invented = 0
    began = time.process_time()
    targets = 20 * args.draws
    for q in rng.uniform(arm.lower, arm.upper, (targets, arm.dof)):
        (p,), (r,) = arm.chain.poses(q[None])
        expected, inside = joints.within(closed_form(p, r, arm.chain.rotation))
        expected = expected[inside]
        found = pose_branches(
            lambda q: (*arm.chain.poses(q), arm.chain.jacobian(q)), p, r, joints, arm.chain.reach
        )
        known += len(expected)
        missed += sum(int(not len(found) or joints.apart(found, e).min() > 1e-4) for e in expected)
        invented += sum(int(joints.apart(expected, f).min() > 1e-4) for f in found)
    yield {
        "targets": targets,
        "branches": known,
        "missed": missed,
        "invented": invented,
        "ms_per_target": round(1e3 * (time.process_time() - began) / targets, 1),
    }


def measure_time(args: argparse.Namespace) -> Iterator[Row]:
    """Processor time of fits."""
    structure = structure_of(calib.load_arm(UR10))
    for name in args.series:
        q, z = series(args.data, name)
        for rows in (2500, 12_000):
            if len(q) < 0.9 * rows:
                continue
            began = time.process_time()
            fit(structure, q[:rows], z[:rows])
            yield {"rows": len(q[:rows]), "seconds": round(time.process_time() - began, 2)}


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "rows": measure_rows,
    "mount": measure_mount,
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
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    lines = []
    with threadpool_limits(1):
        for part in args.part or PARTS:
            for row in PARTS[part](args):
                lines.append({"part": part, **row})
                print(json.dumps(lines[-1]), flush=True)
    if args.json:
        args.json.write_text(json.dumps(lines, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
