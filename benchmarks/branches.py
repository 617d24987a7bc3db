"""Measure the inverse of real URDFs: how near, how many are reached, how many branches.

    python benchmarks/branches.py

URDFs are those of the package example-robot-data; branches of two links are counted against the
closed form.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tables import table
from threadpoolctl import threadpool_limits

import calib
from calib.arm.arm import PlanarArm

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
    """Print the table."""
    with threadpool_limits(1):
        table("Real robots", real_robots())


if __name__ == "__main__":
    main()
