"""Measure the inverse: branches, distances, coverage of the bound, speed beside IK solvers.

    python benchmarks/inverse.py [--json FILE] [--robots] [--quick]

Branches are counted against the closed form of two links.  Speeds are of one run on one
core, because the speed of a machine drifts: quote the ratios.  `--robots` adds real URDFs
of the package example-robot-data; ikpy and pink are measured where they are installed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import calib
from calib.maps.node_bounds import near_border

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from planar import branches_2r

TARGETS = 10_000
SAME = 2e-3  # [rad] an answer this close to a solution of the closed form is that solution
REAL = (
    ("UR10, 2R", "ur_description/urdf/ur10_robot.urdf", ("shoulder_lift_joint", "elbow_joint")),
    (
        "UR10, 3R",
        "ur_description/urdf/ur10_robot.urdf",
        ("shoulder_lift_joint", "elbow_joint", "wrist_1_joint"),
    ),
    ("Panda, 2-4-6", "panda_description/urdf/panda.urdf", tuple(f"panda_joint{k}" for k in "246")),
    ("SO-100", "so_arm_description/urdf/so100.urdf", ("shoulder_lift", "elbow_flex", "wrist_flex")),
    ("SO-101", "so_arm_description/urdf/so101.urdf", ("shoulder_lift", "elbow_flex", "wrist_flex")),
)


def branches(robot: str) -> dict[str, Any]:
    """Branches found, missed and invented for fresh reachable targets."""
    arm = calib.load_arm(robot)
    model = calib.train(calib.babble(arm, 20_000, seed=0))
    q = np.random.default_rng(1).uniform(arm.lower, arm.upper, (TARGETS, arm.dof))
    x = arm.forward(q)
    found = model.inverse_all(x)
    row: dict[str, Any] = {"robot": robot, "targets": TARGETS}
    if arm.dof == 2 and robot != "polar":
        expected = branches_2r(arm, x)
        gaps = [
            np.abs(f[:, None] - e[None]).max(axis=2) for f, e in zip(found, expected, strict=True)
        ]
        row["exist"] = sum(len(e) for e in expected)
        row["missed"] = sum(int((g.min(axis=0) > SAME).sum()) for g in gaps)
        row["invented"] = sum(int((g.min(axis=1) > SAME).sum()) for g in gaps)
    row["answers"] = sum(len(f) for f in found)
    owner = np.repeat(np.arange(TARGETS), [len(f) for f in found])
    away = np.linalg.norm(arm.forward(np.concatenate(found)) - x[owner], axis=1)
    row |= {"mean_mm": 1e3 * float(away.mean()), "max_mm": 1e3 * float(away.max())}
    said = model.inverse(x, near=q)
    row["near_within_5_deg"] = float((np.abs(said - q).max(axis=1) < np.radians(5.0)).mean())
    return row


def coverage(robot: str, noise: float) -> dict[str, Any]:
    """Share of fresh queries whose true error is below the stated 95 % bound."""
    arm = calib.load_arm(robot)
    model = calib.train(calib.babble(arm, 20_000, seed=0, noise=noise))
    rng = np.random.default_rng(2)
    q = rng.uniform(arm.lower, arm.upper, (40_000, arm.dof))
    x = arm.forward(q)
    row: dict[str, Any] = {"robot": robot, "noise_mm": 1e3 * noise}
    answer = model.solve(x, near=q[rng.permutation(len(q))])
    for name, joints, error, bound in (
        ("forward", q, np.linalg.norm(model.forward(q) - x, axis=1), model.expected_error(q)),
        (
            "inverse",
            answer.q,
            np.linalg.norm(arm.forward(answer.q) - x, axis=1),
            answer.expected_error,
        ),
    ):
        held, border = error <= bound, near_border(model.motor, model.motor.scale.to_unit(joints))
        row[name] = float(held.mean())
        row[f"{name}_inside"] = float(held[~border].mean())
        row[f"{name}_border"] = float(held[border].mean())
    return row


def best(run: Callable[[], object], count: int, repeats: int = 5) -> float:
    """Shortest time of a query in several repeats [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append((time.perf_counter() - start) / count)
    return min(times)


def speed(robot: str) -> dict[str, Any]:
    """Time of a query [us]: batches, single calls, and other solvers from the same starts."""
    arm = calib.load_arm(robot)
    model = calib.train(calib.babble(arm, 20_000, seed=0))
    rng = np.random.default_rng(3)
    q = rng.uniform(arm.lower, arm.upper, (100_000, arm.dof))
    x, near = arm.forward(q), np.clip(q + 0.1 * rng.normal(size=q.shape), arm.lower, arm.upper)
    model.inverse(x, near=near)
    few = 300
    result = {
        "robot": robot,
        "batch": best(lambda: model.inverse(x, near=near), len(x), 3),
        "batch_all": best(lambda: model.inverse_all(x[:5000]), 5000, 3),
        "single": best(lambda: [model.inverse(x[i], near=near[i]) for i in range(few)], few),
        "forward_single": best(lambda: [model.forward(q[i]) for i in range(few)], few),
        "pinocchio": best(lambda: pinocchio_dls(arm, x[:few], near[:few]), few),
    }
    for name, solve in (("ikpy", ikpy_loop), ("pink", pink_loop)):
        try:
            result[name] = best(lambda solve=solve: solve(arm, x[:100], near[:100]), 100, 2)
        except ImportError:
            print(f"{name} is not installed: left out", file=sys.stderr)
    return {k: v if isinstance(v, str) else 1e6 * v for k, v in result.items()}


def pinocchio_dls(arm: calib.PlanarArm, x: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Damped least squares with Pinocchio's Jacobian, one target after the other."""
    import pinocchio as pin

    model = pin.buildModelFromXML(arm.urdf)
    data, frame = model.createData(), model.getFrameId(arm.tip)
    basis, origin = arm.plane.basis[:2], arm.plane.origin
    index = [model.joints[model.getJointId(n)].idx_q for n in arm.joint_names]
    full = pin.neutral(model)
    answers = start.copy()
    for i in range(len(x)):
        q = start[i].copy()
        for _ in range(50):
            full[index] = q
            pin.computeJointJacobians(model, data, full)
            pin.updateFramePlacements(model, data)
            gap = x[i] - basis @ (data.oMf[frame].translation - origin)
            if gap @ gap < 1e-18:
                break
            whole = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            jacobian = basis @ whole[:3][:, index]
            damped = jacobian @ jacobian.T + 1e-9 * np.eye(2)
            q = np.clip(q + jacobian.T @ np.linalg.solve(damped, gap), arm.lower, arm.upper)
        answers[i] = q
    return answers


def ikpy_loop(arm: calib.PlanarArm, x: np.ndarray, start: np.ndarray) -> None:
    """Inverse kinematics of ikpy, one target after the other."""
    import tempfile

    from ikpy.chain import Chain

    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file.write(arm.urdf)
        file.flush()
        chain = Chain.from_urdf_file(file.name, base_elements=["base"])
        names = [link.name for link in chain.links]
        chain.active_links_mask = [name in arm.joint_names for name in names]
        for target, near in zip(x, start, strict=True):
            q = np.zeros(len(names))
            q[[names.index(n) for n in arm.joint_names]] = near
            goal = arm.plane.origin + target @ arm.plane.basis[:2]
            chain.inverse_kinematics(goal, initial_position=q)


def pink_loop(arm: calib.PlanarArm, x: np.ndarray, start: np.ndarray) -> None:
    """Differential inverse kinematics of pink, stepped until it stands on the target."""
    import pink
    import pinocchio as pin
    import qpsolvers

    if not qpsolvers.available_solvers:
        raise ImportError("qpsolvers has no solver")
    model = pin.buildModelFromXML(arm.urdf)
    task = pink.tasks.FrameTask(arm.tip, position_cost=1.0, orientation_cost=0.0)
    for target, near in zip(x, start, strict=True):
        configuration = pink.Configuration(model, model.createData(), near.copy())
        goal = pin.SE3.Identity()
        goal.translation = arm.plane.origin + target @ arm.plane.basis[:2]
        task.set_target(goal)
        for _ in range(50):
            velocity = pink.solve_ik(
                configuration,
                [task],
                1.0,
                solver=qpsolvers.available_solvers[0],
                safety_break=False,
            )
            configuration.integrate_inplace(velocity, 1.0)
            if np.linalg.norm(task.compute_error(configuration)[:3]) < 1e-9:
                break


def real_robots() -> list[dict[str, Any]]:
    """Answers on real URDFs: how far from the target, and how many are reached."""
    import pinocchio

    folder = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"
    rows = []
    for name, file, joints in REAL:
        path = folder / file
        if not path.exists():
            print(f"{name}: {file} is not there, left out", file=sys.stderr)
            continue
        try:
            arm = calib.load_arm(path, joints=list(joints))
        except calib.CalibError as error:
            print(f"{name}: {error}", file=sys.stderr)
            continue
        model = calib.train(calib.babble(arm, 20_000, seed=0))
        q = np.random.default_rng(4).uniform(arm.lower, arm.upper, (3000, arm.dof))
        x = arm.forward(q)
        answer, near = model.solve(x), model.inverse(x, near=q)
        away = np.linalg.norm(arm.forward(answer.q) - x, axis=1)
        turn = np.abs((near - q + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
        row = {
            "robot": name,
            "reached": float(answer.reachable.mean()),
            "mean_mm": 1e3 * float(away.mean()),
            "max_mm": 1e3 * float(away.max()),
            "near_within_5_deg": float((turn < np.radians(5.0)).mean()),
            "answers_per_target": float(np.mean([len(a) for a in model.inverse_all(x[:1000])])),
            "train_s": model.seconds["total"],
        }
        if arm.dof == 2:
            expected, found = branches_2r(arm, x[:1000]), model.inverse_all(x[:1000])
            row["exist"] = sum(len(e) for e in expected)
            row["found"] = sum(len(f) for f in found)
        rows.append(row)
    return rows


def show(title: str, rows: list[dict[str, Any]]) -> None:
    """Print a table."""
    print(f"\n{title}")
    for row in rows:
        print("  " + "  ".join(f"{k} {v:.5g}" if isinstance(v, float) else f"{k} {v}"
                               for k, v in row.items()))  # fmt: skip


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--robots", action="store_true", help="also real URDFs")
    parser.add_argument("--quick", action="store_true", help="two robots, one noise")
    options = parser.parse_args()
    robots = ["two_link_full", "scara"] + ([] if options.quick else ["two_link", "three_link"])
    noises = (1e-3,) if options.quick else (0.0, 1e-3)
    with threadpool_limits(1):
        tables = {
            "branches": [branches(robot) for robot in robots],
            "coverage": [coverage(robot, noise) for robot in robots for noise in noises],
            "speed_us": [speed("two_link_full")],
            "robots": real_robots() if options.robots else [],
        }
    for row in tables["speed_us"]:
        for name in ("pinocchio", "ikpy", "pink"):
            if name in row:
                row[f"{name}_over_batch"] = row[name] / row["batch"]
    for title, rows in tables.items():
        show(title, rows)
    if options.json:
        Path(options.json).write_text(json.dumps(tables, indent=1) + "\n")


if __name__ == "__main__":
    main()
