"""Measure the bars of the inverse: processor time of a row, and branches of a UR5.

    python benchmarks/inverse.py [--quick]

Six joints are `six_axis`, simulated and as a log teaches it.  Times are processor time, of all
threads, with the compiled C unless a row says otherwise; beside them stands a lean damped
least-squares loop of Pinocchio, two joints, from 5 mrad away.  The UR5 is the one of the package
example-robot-data, its analytic branches are checked with Pinocchio's kinematics.
"""

import pickle
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from branches import UR10, shared_robots
from realtime import Array, lean_loop, six_axis, sweep
from tables import table, typed
from threadpoolctl import threadpool_limits

import calib
from calib.inverse.closed_form import ClosedForm
from calib.model.poses import solve_poses

UR5 = UR10.replace("ur10", "ur5")
POSES = 140
SAME = 1e-4  # [rad] an answer so close to an analytic branch is that branch
NEAR = 0.5  # [rad] between joints and those that a batch begins at
POSE_NEAR = 0.2


def row_time(call: Callable[[], Any], rows: int) -> float:
    """Processor time of one row of a call [us]."""
    started = time.process_time()
    call()
    return 1e6 * (time.process_time() - started) / rows


def drawn(model: Any, n: int, seed: int = 0) -> Array:
    """Joints all over the ranges of a model, (n, dof)."""
    about = model.about
    return np.random.default_rng(seed).uniform(about.lower, about.upper, (n, len(about.lower)))


def beside(model: Any, q: Array, away: float) -> Array:
    """Joints (n, dof) at most so far from others."""
    shift = np.random.default_rng(1).uniform(-away, away, q.shape)
    return np.clip(q + shift, model.about.lower, model.about.upper)


def batches(model: Any, rows: int) -> Iterator[tuple[str, float]]:
    """Time of a row of each batch that six joints have a bar for."""
    q = drawn(model, rows)
    x = model.forward(q)
    near = beside(model, q, NEAR)
    yield "forward", row_time(lambda: model.forward(q), rows)
    yield "expected error", row_time(lambda: model.expected_error(q), rows)
    yield "inverse near", row_time(lambda: model.inverse(x, near=near), rows)
    yield "inverse", row_time(lambda: model.inverse(x), rows)
    few = max(rows // 10, 1)
    position, turn = model.pose(q[:few])
    close = beside(model, q[:few], POSE_NEAR)
    yield "poses near", row_time(lambda: model.inverse_pose(position, turn, close), few)

    def every() -> Any:
        return solve_poses(model, position, turn, every=True, bounded=False)

    yield "poses, all branches", row_time(every, few)


BARS = {
    "forward": 1.0,
    "expected error": 3.0,
    "inverse near": 10.0,
    "inverse": 60.0,
    "poses near": 25.0,
    "poses, all branches": 400.0,
}
"""Processor time of a row [us]."""


def six_joints(rows: int) -> Iterator[dict[str, Any]]:
    """Rows of the table of six joints."""
    simulated = calib.train(calib.babble(calib.load_arm("six_axis"), 2000, seed=0))
    of_a_log = six_axis()
    for model in (simulated, of_a_log):
        model.warm_up()
    measured = zip(batches(simulated, rows), batches(of_a_log, rows), strict=True)
    for (name, first), (_, second) in measured:
        yield {"us a row": name, "simulated": first, "of a log": second, "bar": BARS[name]}


def without_compiler(model: Any, quick: bool) -> Iterator[dict[str, Any]]:
    """Single answers by NumPy."""
    cold = pickle.loads(pickle.dumps(model))
    calls = 5 if quick else 50
    q = sweep(cold, calls)
    if len(q[0]) == 2:
        x = cold.forward(q)
        near = beside(cold, q, NEAR)
        cold.inverse(x[0], near=near[0])

        def one_each() -> None:
            for k in range(calls):
                cold.inverse(x[k], near=near[k])

        yield {"call": "planar inverse", "us": row_time(one_each, calls), "bar": 300.0}
    else:
        position, turn = cold.pose(q)
        near = beside(cold, q, POSE_NEAR)
        cold.inverse_pose(position[0], turn[0], near[0])

        def one_each() -> None:
            for k in range(calls):
                cold.inverse_pose(position[k], turn[k], near[k])

        yield {"call": "inverse_pose", "us": row_time(one_each, calls), "bar": 5000.0}


def planar(rows: int, quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of the table of two joints."""
    model = calib.train(calib.babble(calib.load_arm("two_link"), 20_000, seed=0))
    yield from without_compiler(model, quick)
    yield from without_compiler(six_axis(), quick)
    q = sweep(model, 500)
    loop = lean_loop(q, model.forward(q))

    def lean() -> None:
        for k in range(500):
            loop(k)

    yield {"call": "Pinocchio, lean loop", "us": row_time(lean, 500)}
    model.warm_up()
    x = model.forward(drawn(model, rows))
    every = row_time(lambda: model.inverse_all(x), rows)
    yield {"call": f"all branches of {rows:,} positions", "us": every, "bar": 2.0}


def ur5_branches() -> dict[str, Any]:
    """Branches of a UR5 at poses: found, missed, invented and twice."""
    arm = calib.load_arm(shared_robots() / UR5)
    model = calib.train(calib.babble(arm, 2000, seed=0))
    model.warm_up()
    q = np.random.default_rng(2).uniform(arm.lower, arm.upper, (POSES, 6))
    position, turn = arm.pose(q)
    answers = solve_poses(model, position, turn, every=True, bounded=False, frame="base")
    closed = ClosedForm.of(arm.chain)
    assert closed is not None
    analytic = closed.joints(*arm.chain.poses(q))
    reached, turned = arm.chain.poses(analytic.reshape(-1, 6))
    places, turns = arm.chain.poses(q)
    gap = np.abs(reached.reshape(POSES, -1, 3) - places[:, None]).max(axis=2)
    tilt = np.abs(turned.reshape(POSES, -1, 3, 3) - turns[:, None]).max(axis=(2, 3))
    exact = np.maximum(gap, tilt) < 1e-8
    missed = invented = twice = 0
    for k in range(POSES):
        found = answers.q[answers.target == k]
        expected = analytic[k][exact[k]]
        apart = _apart(found, expected)
        missed += int((apart.min(axis=0) > SAME).sum())
        invented += int((apart.min(axis=1) > SAME).sum())
        among = _apart(found, found) + np.eye(len(found))
        twice += int((among < SAME).sum() // 2)
    return {
        "poses": POSES,
        "analytic": int(exact.sum()),
        "found": len(answers.q),
        "missed": missed,
        "invented": invented,
        "twice": twice,
    }


def _apart(a: Array, b: Array) -> Array:
    """Largest distance (n, k) of any joint between rows, the short way round."""
    gap = a[:, None] - b[None]
    return np.asarray(np.abs((gap + np.pi) % (2 * np.pi) - np.pi).max(axis=2))


def main() -> None:
    """Print the tables."""
    options = typed(__doc__, quick=False)
    with threadpool_limits(1):
        table("Six joints", six_joints(1000 if options.quick else 20_000))
        rows = 10_000 if options.quick else 1_000_000
        table("Single calls, two joints", planar(rows, options.quick))
        table("Branches of a UR5", [ur5_branches()])


if __name__ == "__main__":
    main()
