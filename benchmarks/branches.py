"""Measure the inverse: branches, distances, coverage of the bound.

    python benchmarks/branches.py [--robots] [--quick]

Branches are counted against the closed form of two links.  `--robots` adds real URDFs of the
package example-robot-data.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tables import table, typed
from threadpoolctl import threadpool_limits

import calib
from calib.arm.arm import PlanarArm
from calib.maps.node_bounds import near_border

TARGETS = 10_000
SAME = 2e-3  # [rad] an answer this close to a solution of the closed form is that solution
UR10 = "ur_description/urdf/ur10_robot.urdf"
SO = "shoulder_lift,elbow_flex,wrist_flex"
REAL = (
    ("UR10, 2R", UR10, "shoulder_lift_joint,elbow_joint"),
    ("UR10, 3R", UR10, "shoulder_lift_joint,elbow_joint,wrist_1_joint"),
    ("Panda, 2-4-6", "panda_description/urdf/panda.urdf", "panda_joint2,panda_joint4,panda_joint6"),
    ("SO-100", "so_arm_description/urdf/so100.urdf", SO),
    ("SO-101", "so_arm_description/urdf/so101.urdf", SO),
)


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
            "train_s": model.seconds["total"],
        }


def main() -> None:
    """Run what was asked for."""
    options = typed(__doc__, robots=False, quick=False)
    robots = ["two_link_full", "scara"] + ([] if options.quick else ["two_link", "three_link"])
    noises = (1e-3,) if options.quick else (0.0, 1e-3)
    with threadpool_limits(1):
        for robot in robots:
            table(f"Branches of {robot}", [branches(robot)])
        table("Coverage", (coverage(robot, noise) for robot in robots for noise in noises))
        table("Real robots", real_robots() if options.robots else ())


if __name__ == "__main__":
    main()
