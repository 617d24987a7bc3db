"""Measure what one call costs in a control loop: median, 99th and 99.9th percentile.

    python benchmarks/realtime.py [--calls N] [--model MODEL]

Measured are `two_link`, and `six_axis` as a log would teach it: placements, gravity and joint
curves are off.  Each call gets a fresh pose of a slow sweep, as a controller would ask.  Times are
processor time of the thread, which other work on the machine does not disturb much, with the
compiled C and, of fewer calls, without a compiler.
Beside `two_link` runs a lean damped least-squares loop on Pinocchio with the nominal arm
(framesForwardKinematics, computeFrameJacobian, a 2x2 solve, at most five steps from near).
"""

import gc
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tables import table, typed

import calib

Array = NDArray[np.float64]

NEAR = 5e-3  # rad between a pose and the start of the search for it


WORKING = np.array([0.3, -1.2, 1.4, -0.8, 1.2, 0.4])
"""A posture of six joints that is not singular [rad]; the sweep leaves it by 0.35 rad."""


def sweep(model: Any, n: int) -> Array:
    """A slow sweep through the middle of the joints' range, (n, dof)."""
    lower, upper = model.about.lower, model.about.upper
    t = np.arange(n)[:, None] * 2e-3
    phase = np.arange(1, len(lower) + 1)
    wave = 0.35 * np.sin(t * phase + phase)
    if len(lower) == 6:
        return np.asarray(WORKING + wave)
    return np.asarray((lower + upper) / 2 + (upper - lower) * wave)


def six_axis() -> Any:
    """A model of a log of 300 rows of an arm that differs from its URDF everywhere."""
    from calib.body.spatial import structure_of

    arm = calib.load_arm("six_axis")
    structure = structure_of(arm, "rigid")
    rng, beta = np.random.default_rng(0), structure.neutral()
    groups = structure.groups
    for group, size in (("view.rotation", 1.0), ("view.shift", 1.0), ("elastic", 1e-3)):
        beta[groups[group]] = rng.normal(0, size, len(groups[group]))
    beta[structure.shifts] = rng.normal(0, 5e-4, structure.shifts.shape)
    beta[structure.turns] = rng.normal(0, 1e-3, structure.turns.shape)
    for k in range(6):
        beta[groups[f"curve.{k}"][[9, 48 + 14]]] = rng.normal(0, 3e-4, 2)
    q = rng.uniform(arm.lower, arm.upper, (300, 6))
    x = structure.predict(q, beta) + rng.normal(0, 3e-5, (300, 3))
    ranges = arm.joint_names, arm.lower, arm.upper, arm.revolute
    return calib.train(calib.Samples(q, x, *ranges, arm=arm, unit="m"), size=20)


def latencies(call: Callable[[int], Any], n: int, clock: Callable[[], int]) -> dict[str, float]:
    """Of `n` calls the median, the 99th and 99.9th percentile [us]."""
    for k in range(min(200, n)):
        call(k)
    gc.collect()
    gc.disable()
    taken = np.empty(n)
    for k in range(n):
        start = clock()
        call(k)
        taken[k] = clock() - start
    gc.enable()
    median, p99, p999 = np.quantile(taken, [0.5, 0.99, 0.999]) / 1e3
    return {"median": median, "99 %": p99, "99.9 %": p999}


def lean_loop(q: Array, x: Array) -> Callable[[int], Any]:
    """Pinocchio's inverse kinematics as a lean loop, nominal arm, from a near start."""
    import pinocchio as pin

    from calib.arm.robots import resolve_robot

    model = pin.buildModelFromXML(resolve_robot("two_link").read_text())
    data = model.createData()
    frame = model.getFrameId(calib.load_arm("two_link").tip, pin.FrameType.BODY)
    local = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def solve(k: int) -> Array:
        joints, target = q[k] + NEAR, x[k]
        for _ in range(5):
            pin.framesForwardKinematics(model, data, joints)
            gap = target - data.oMf[frame].translation[:2]
            if gap[0] * gap[0] + gap[1] * gap[1] < 1e-20:
                break
            slope = pin.computeFrameJacobian(model, data, joints, frame, local)[:2]
            power = slope @ slope.T
            power[0, 0] += 1e-12
            power[1, 1] += 1e-12
            joints = joints + slope.T @ np.linalg.solve(power, gap)
        return joints

    return solve


def cases(model: Any, calls: int) -> tuple[dict[str, Callable[[int], Any]], Array, Array]:
    """Calls by name, each with the number of a pose; the poses and their positions."""
    q, rng = sweep(model, calls), np.random.default_rng(0)
    x, lower, upper = model.forward(q), model.about.lower, model.about.upper
    near = np.clip(q + rng.uniform(-0.5, 0.5, q.shape), lower, upper)
    found: dict[str, Callable[[int], Any]] = {
        "forward(q)": lambda k: model.forward(q[k]),
        "forward and expected_error": lambda k: (model.forward(q[k]), model.expected_error(q[k])),
        "inverse(x, near), 0.5 rad away": lambda k: model.inverse(x[k], near=near[k]),
        "correct(q)": lambda k: calib.correct(model, q[k]),
    }
    if len(q[0]) >= 6:
        close = np.clip(q + rng.uniform(-0.2, 0.2, q.shape), lower, upper)
        turns = model.pose(q)[1]
        found["inverse_pose, 0.2 rad away"] = lambda k: model.inverse_pose(x[k], turns[k], close[k])
    return found, q, x


def measure(model: Any, calls: int) -> Iterator[dict[str, Any]]:
    """Rows of the table: with a compiler, and the median without."""
    clock = time.thread_time_ns
    found, q, x = cases(model, calls)
    batch = {name: latencies(call, max(20, calls // 20), clock) for name, call in found.items()}
    print(model.warm_up(), flush=True)
    if model.about.robot == "two_link":
        found["Pinocchio, lean loop, 5 mrad away"] = lean_loop(q, x)
    for name, call in found.items():
        alone = batch.get(name, {"median": math.nan})["median"]
        row = {"one call [us]": name, **latencies(call, calls, clock)}
        yield row | {"median without a compiler": alone}


def main() -> None:
    """Run the measurement and print a table."""
    options = typed(__doc__, calls=5000, model=Path)
    if options.model is not None:
        models = {options.model.name: calib.load(options.model)}
    else:
        arm = calib.load_arm("two_link")
        models = {
            "two joints": calib.train(calib.babble(arm, 3000, seed=0), size=20),
            "six joints in space": six_axis(),
        }
    for title, model in models.items():
        table(title, measure(model, options.calls))


if __name__ == "__main__":
    main()
