"""Simulated arms for `benchmarks/spatial.py`: without curves, before a camera, poses.

It also holds what both files measure with.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio

import calib
from calib.arm.rotations import logarithm
from calib.body.belief import Body
from calib.body.fitting import BodyFit, fit_structure
from calib.body.sensor import SensorPose
from calib.body.spatial import SpatialStructure, structure_of
from calib.inverse.pose import Joints, pose_branches
from calib.model.base import in_base

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from closed_form import closed_form

ROBOTS = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"
UR10 = ROBOTS / "ur_description/urdf/ur10_robot.urdf"
SO101 = ROBOTS / "so_arm_description/urdf/so101.urdf"
MM = 1e3

Row = dict[str, Any]


def spread(z: np.ndarray) -> float:
    """Rms distance of rows from their mean."""
    return float(np.sqrt(((z - z.mean(axis=0)) ** 2).sum(axis=1).mean()))


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
                beta[structure.shifts[1:]] = rng.normal(0, 1e-3, (5, 3))
                beta[structure.turns[1:]] = rng.normal(0, 2e-3, (5, 3))
                q, fresh = (rng.uniform(arm.lower, arm.upper, (n, 6)) for n in (rows, 500))
                z = structure.predict(q, beta) + rng.normal(0, noise, (rows, 3))
                true = structure.predict(fresh, beta)
                both = [structure, UpTo.of(structure, "chain")]
                errors = [distance(fit(each, q, z).body, fresh, true).mean() for each in both]
                ratios.append(float(errors[0] / errors[1]))
            yield {
                "noise_mm": MM * noise,
                "rows": rows,
                "ratio": round(float(np.mean(ratios)), 3),
                "worst": round(max(ratios), 3),
            }


def measure_camera(args: argparse.Namespace) -> Iterator[Row]:
    """A simulated SO-101 in 60 pictures of an unknown camera, 0.3 px."""
    for exact in (True, False):
        for seed in range(args.draws):
            yield _camera(seed, exact)


def _camera(seed: int, exact: bool) -> Row:
    arm = calib.load_arm(SO101)
    structure = structure_of(arm, "pinhole", unit="px")
    rng, groups = np.random.default_rng(seed), structure.groups
    beta = structure.neutral()
    beta[groups["offset"][1:]] = np.deg2rad(rng.uniform(-5, 5, arm.dof - 1))
    if not exact:
        beta[structure.shifts[1:]] = rng.normal(0, 1e-3, (arm.dof - 1, 3))
        beta[structure.turns[1:]] = np.deg2rad(rng.normal(0, 0.2, (arm.dof - 1, 3)))
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
    camera = SensorPose.of(body)
    assert camera is not None
    whole, shape = in_base(body), in_base(body, size=False)
    assert whole is not None and shape is not None  # noqa: PT018 - an informed arm in space
    base, but_size = (each.bound(fresh, noise=False) for each in (whole, shape))
    axis, reach = structure.chain.axes[0], found - structure.chain.points[0]
    # by convention: a turn about and a shift along the first axis; not told: the size
    ways = [np.cross(axis, reach), np.broadcast_to(axis, reach.shape), reach]

    def left(count: int) -> np.ndarray:
        columns = np.stack([way.ravel() for way in ways[:count]], axis=1)
        rest = (true - found).ravel()
        rest = rest - columns @ np.linalg.lstsq(columns, rest, rcond=None)[0]
        return np.linalg.norm(rest.reshape(-1, 3), axis=1)

    return {
        "placements": "exact" if exact else "off by 1 mm, 0.2 deg",
        "seed": seed,
        "member": body.member,
        "pixels": round(float(error.mean()), 3),
        "covered": _share(error <= bound),
        "tip_mm": round(MM * float(np.linalg.norm(found - true, axis=1).mean()), 3),
        "tip_up_to_similarity_mm": round(MM * float(up_to.mean()), 3),
        "base_mm": round(MM * float(base.mean()), 2),
        "base_covered": _share(left(2) <= base),
        "shape_mm": round(MM * float(but_size.mean()), 2),
        "shape_covered": _share(left(3) <= but_size),
        "camera_mm": round(MM * float(np.linalg.norm(camera.position - eye)), 2),
        "camera_deg": round(
            float(np.degrees(np.linalg.norm(logarithm(camera.rotation @ turn)))), 3
        ),
    }


def _share(held: np.ndarray) -> float:
    return round(100 * float(held.mean()), 1)


def _degrees(rotation: np.ndarray) -> float:
    return float(np.degrees(np.linalg.norm(logarithm(rotation))))


def measure_poses(args: argparse.Namespace) -> Iterator[Row]:
    """Branches of the bundled six-axis arm against its closed form."""
    arm = calib.load_arm("six_axis")
    joints = Joints(arm.lower, arm.upper, arm.revolute)
    rng = np.random.default_rng(0)
    known = missed = invented = 0
    began = time.process_time()
    targets = 20 * args.draws
    evaluate = lambda q: (*arm.chain.poses(q), arm.chain.jacobian(q))  # noqa: E731
    for q in rng.uniform(arm.lower, arm.upper, (targets, arm.dof)):
        (p,), (r,) = arm.chain.poses(q[None])
        expected, inside = joints.within(closed_form(p, r, arm.chain.rotation))
        expected = expected[inside]
        (found,) = pose_branches(evaluate, p[None], r[None], joints, arm.chain.reach)
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
