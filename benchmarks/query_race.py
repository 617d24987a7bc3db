"""Queries of a 70x70 model on one core, beside nearest neighbours and solvers of kinematics.

With one thread the processor time is what a query takes on an idle machine, and other work
on the machine does not disturb it.
"""

import json
import os
import statistics
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from measure import ONE_CORE, child, timed

SAMPLES = 20_000
BATCH = 100_000
FEW = 200
SLOW = 40  # targets of solvers that take milliseconds each
NEAR = 0.01  # rad between a target's joints and those given, as in a control loop


def queries(quick: bool) -> dict[str, Any]:
    """Measure in a process that is bound to one core."""
    task = {"quick": quick}
    saved = {name: os.environ.get(name) for name in ONE_CORE}
    os.environ.update(ONE_CORE)
    try:
        return child(Path(__file__), task) or {}
    finally:
        for name, value in saved.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _measure(quick: bool) -> dict[str, Any]:
    import calib

    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    size, samples = (20, 2000) if quick else (70, SAMPLES)
    batch, few, slow = (5000, 20, 4) if quick else (BATCH, FEW, SLOW)
    repeats = 2 if quick else 7
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, samples, seed=0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "two_link.calib"
        calib.train(log, size=size).save(path)
        megabytes = path.stat().st_size / 1e6
        calib.load(path)
        load = [timed(lambda: calib.load(path)) for _ in range(5 * repeats)]
        model = calib.load(path)
    rng = np.random.default_rng(3)
    q = rng.uniform(arm.lower, arm.upper, (batch, arm.dof))
    x = arm.forward(q)
    near = np.clip(q + NEAR * rng.normal(size=q.shape), arm.lower, arm.upper)
    # name: what is run, how many queries it answers, how its answer is judged
    runs: dict[str, tuple[Callable[[], Any], int, Callable[[Any], Any] | None]] = {
        "forward, batch": (lambda: model.forward(q), batch, lambda a: a - x),
        "inverse, batch, near given": (
            lambda: model.inverse(x, near=near), batch, lambda a: arm.forward(a) - x),
        "inverse, batch": (lambda: model.inverse(x), batch, lambda a: arm.forward(a) - x),
        "forward, one": (lambda: [model.forward(a) for a in q[:few]], few, None),
        "inverse, one, near given": (
            lambda: [model.inverse(x[i], near=near[i]) for i in range(few)], few, None),
        "inverse, one": (lambda: [model.inverse(a) for a in x[:few]], few, None),
    }  # fmt: skip
    left_out = _peers(runs, arm, log, q, x, near, few, slow)
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    wall: dict[str, list[float]] = {name: [] for name in runs}
    answers: dict[str, Any] = {name: run() for name, (run, _, _) in runs.items()}
    for _ in range(repeats):
        for name, (run, count, _) in runs.items():
            # solvers of milliseconds would take the whole time
            if count == slow and len(seconds[name]) >= 2:
                continue
            waited, spent, _ = timed(run)
            seconds[name].append(spent / count)
            wall[name].append(waited / count)
    rows = []
    for name, (_, count, judge) in runs.items():
        row = {"name": name, "wall_us": 1e6 * statistics.median(wall[name]),
               "us": 1e6 * statistics.median(seconds[name]),
               "least_us": 1e6 * min(seconds[name]), "most_us": 1e6 * max(seconds[name]),
               "queries": count}  # fmt: skip
        if judge is not None:
            gap = np.linalg.norm(judge(answers[name]), axis=1)
            known = np.isfinite(gap)
            row |= {"mean_mm": 1e3 * float(gap[known].mean()),
                    "max_mm": 1e3 * float(gap[known].max()),
                    "unanswered": int(np.count_nonzero(~known))}  # fmt: skip
        rows.append(row)
    return {
        "size": size,
        "samples": samples,
        "rows": rows,
        "left_out": left_out,
        "file_mb": megabytes,
        "load_ms": 1e3 * statistics.median(spent for _, spent, _ in load),
    }


def _peers(
    runs: dict[str, Any], arm: Any, log: Any, q: Any, x: Any, near: Any, few: int, slow: int
) -> list[str]:
    """Add what is installed to `runs`; returns what is not."""
    missing = []
    try:
        from sklearn.neighbors import KNeighborsRegressor
    except ImportError:
        missing.append("scikit-learn")
    else:
        there, back = (KNeighborsRegressor(5, weights="distance") for _ in range(2))
        there.fit(log.q, log.x)
        back.fit(log.x, log.q)
        runs["forward, batch, nearest neighbours"] = (
            lambda: there.predict(q), len(q), lambda a: a - x)  # fmt: skip
        runs["inverse, batch, nearest neighbours"] = (
            lambda: back.predict(x), len(x), lambda a: arm.forward(a) - x)  # fmt: skip
    loops = {"Pinocchio, damped least squares": (pinocchio_dls, few), "ikpy": (ikpy_loop, slow)}
    for name, (solve, count) in loops.items():
        try:
            solve(arm, x[:2], near[:2])
        except ImportError as error:
            missing.append(f"{name} ({error})")
        else:
            run = partial(solve, arm, x[:count], near[:count])
            runs[f"inverse, one, {name}"] = (run, count, None)
    return missing


def pinocchio_dls(arm: Any, x: Any, start: Any) -> Any:
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


def ikpy_loop(arm: Any, x: Any, start: Any) -> None:
    """Inverse kinematics of ikpy, one target after the other."""
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


if __name__ == "__main__":
    asked = json.loads(sys.argv[sys.argv.index("--child") + 1])
    print(json.dumps(_measure(asked["quick"])))
