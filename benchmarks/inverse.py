"""Measure the bars of the inverse: processor time of a row, branches of a UR5, real robots.

    python benchmarks/inverse.py [--quick]

Six joints are `six_axis`, simulated and as a log teaches it.  Times are processor time, of all
threads, with the compiled C unless a row says otherwise; beside them stands a lean damped
least-squares loop of Pinocchio, two joints, from 5 mrad away.  Real robots are those of the package
example-robot-data; branches of a UR5 and of two links are counted against closed forms.
"""

import pickle
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from realtime import Array, lean_loop, six_axis, sweep
from tables import table, typed
from threadpoolctl import threadpool_limits

import calib
from calib.arm.arm import PlanarArm
from calib.inverse.closed_form import ClosedForm
from calib.model.poses import solve_poses

UR10 = "ur_description/urdf/ur10_robot.urdf"
SO = "shoulder_lift,elbow_flex,wrist_flex"
REAL = (
    ("UR10, 2R", UR10, "shoulder_lift_joint,elbow_joint"),
    ("UR10, 3R", UR10, "shoulder_lift_joint,elbow_joint,wrist_1_joint"),
    ("Panda, 2-4-6", "panda_description/urdf/panda.urdf", "panda_joint2,panda_joint4,panda_joint6"),
    ("SO-100", "so_arm_description/urdf/so100.urdf", SO),
    ("SO-101", "so_arm_description/urdf/so101.urdf", SO),
)
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


def branches_2r(arm: PlanarArm, x: np.ndarray) -> list[np.ndarray]:
    """Every solution inside the limits, by the law of cosines: a (k, 2) array per target.

    The geometry c + R(s q1) a + R(s q1 + t q2) b is fitted to the arm's own positions.
    """
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (200, 2))
    seen = arm.forward(q) @ (1, 1j)
    for s, t in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        columns = [np.ones(200), np.exp(1j * s * q[:, 0]), np.exp(1j * (s * q[:, 0] + t * q[:, 1]))]
        fit = np.linalg.lstsq(np.stack(columns, axis=1), seen, rcond=None)[0]
        if np.abs(np.stack(columns, axis=1) @ fit - seen).max() < 1e-9:
            break
    else:
        raise AssertionError("not an arm of two turning joints")
    c, a, b = fit
    z = x @ (1, 1j) - c
    cosine = (np.abs(z) ** 2 - abs(a) ** 2 - abs(b) ** 2) / (2 * abs(a) * abs(b))
    found: list[list[np.ndarray]] = [[] for _ in x]
    for sign in (1, -1):
        bend = sign * np.arccos(np.clip(cosine, -1, 1)) + np.angle(a) - np.angle(b)
        turn = np.angle(z) - np.angle(a + np.exp(1j * bend) * b)
        q = np.stack([s * turn, t * bend], axis=1)
        q = arm.lower + (q - arm.lower + 1e-9) % (2 * np.pi) - 1e-9
        inside = (np.abs(cosine) <= 1) & (q <= arm.upper + 1e-9).all(axis=1)
        for i in np.flatnonzero(inside):
            if not found[i] or np.abs(found[i][0] - q[i]).max() > 1e-6:
                found[i].append(q[i])
    return [np.array(f).reshape(-1, 2) for f in found]


def shared_robots() -> Path:
    """Folder of the package example-robot-data."""
    import pinocchio

    return Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"


def real_robots() -> Iterator[dict[str, Any]]:
    """Answers on real URDFs: how far from the target, and how many are reached."""
    folder = shared_robots()
    for name, file, joints in REAL:
        arm = calib.load_arm(folder / file, joints=joints.split(","))
        model = calib.train(calib.babble(arm, 20_000, seed=0))
        q = np.random.default_rng(4).uniform(arm.lower, arm.upper, (3000, arm.dof))
        x = arm.forward(q)
        answer, near, found = model.solve(x), model.inverse(x, near=q), model.inverse_all(x[:1000])
        away = np.linalg.norm(arm.forward(answer.q) - x, axis=1)
        turn = np.abs((near - q + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
        expected = branches_2r(arm, x[:1000]) if arm.dof == 2 else ()
        yield {
            "robot": name,
            "reached": float(answer.reachable.mean()),
            "mean_mm": 1e3 * float(away.mean()),
            "max_mm": 1e3 * float(away.max()),
            "near_within_5_deg": float((turn < np.radians(5.0)).mean()),
            "answers": sum(map(len, found)),
            "exist": sum(map(len, expected)) or "",
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
        table("Planar parts of real robots", () if options.quick else real_robots())


if __name__ == "__main__":
    main()
