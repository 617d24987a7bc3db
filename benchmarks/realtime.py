"""Measure what one call costs in a control loop: median, 99th and 99.9th percentile.

    python benchmarks/realtime.py [--calls N] [--model MODEL] [--json FILE]

Each call gets a fresh pose of a slow sweep, as a controller would ask.  Beside them runs a
lean damped least-squares loop on Pinocchio with the nominal arm (framesForwardKinematics,
computeFrameJacobian, a 2x2 solve, at most five steps from a start that is near).
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import calib

Array = NDArray[np.float64]

NEAR = 5e-3  # rad between a pose and the start of the search for it


def sweep(model: Any, n: int) -> Array:
    """A slow sweep through the middle of the joints' range, (n, dof)."""
    lower, upper = model.about.lower, model.about.upper
    t = np.arange(n)[:, None] * 2e-3
    phase = np.arange(1, len(lower) + 1)
    return np.asarray((lower + upper) / 2 + 0.35 * (upper - lower) * np.sin(t * phase + phase))


def latencies(call: Callable[[int], Any], n: int) -> Array:
    """Time of each of `n` calls [us]."""
    for k in range(min(200, n)):
        call(k)
    gc.collect()
    gc.disable()
    taken = np.empty(n)
    clock = time.perf_counter_ns
    for k in range(n):
        start = clock()
        call(k)
        taken[k] = clock() - start
    gc.enable()
    return taken / 1e3


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


def measure(model: Any, calls: int) -> dict[str, dict[str, float]]:
    """Latencies of each call of a warm model."""
    model.warm_up()
    q = sweep(model, calls)
    x = model.forward(q)
    near = q + NEAR
    monitor = model.monitor()
    cases: dict[str, Callable[[int], Any]] = {
        "forward(q)": lambda k: model.forward(q[k]),
        "expected_error(q)": lambda k: model.expected_error(q[k]),
        "forward and expected_error": lambda k: (model.forward(q[k]), model.expected_error(q[k])),
        "inverse(x, near=q)": lambda k: model.inverse(x[k], near=near[k]),
        "monitor.update(q, x)": lambda k: monitor.update(q[k], x[k]),
    }
    if model.about.urdf:
        cases["correct(q)"] = lambda k: model.correct(q[k])
    if len(q[0]) == 2 and model.about.robot == "two_link":
        cases["Pinocchio, lean loop"] = lean_loop(q, x)
    found = {}
    for name, call in cases.items():
        taken = latencies(call, calls)
        found[name] = {
            "median": float(np.median(taken)),
            "p99": float(np.quantile(taken, 0.99)),
            "p999": float(np.quantile(taken, 0.999)),
        }
    return found


def main() -> None:
    """Run the measurement and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=5000)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.model is not None:
        model = calib.load(options.model)
    else:
        model = calib.train(calib.babble(calib.load_arm("two_link"), 20_000, seed=0))
    found = measure(model, options.calls)
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    print(f"{'one call [us]':30} {'median':>8} {'99 %':>8} {'99.9 %':>8}")
    for name, row in found.items():
        print(f"{name:30} {row['median']:8.1f} {row['p99']:8.1f} {row['p999']:8.1f}")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
