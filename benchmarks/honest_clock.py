"""Honest clocks: positions that are late against the joints, along paths, planar and in space.

A part of benchmarks/honesty.py.  Truth is the arm that was simulated, at joints along the path and
beside it; a bound covers where the error is below it.
"""

from collections.abc import Iterator

import numpy as np
from honest_worlds import Row, row

import calib
from calib.samples.samples import Samples

LATE = (0.0, 0.005, 0.02, -0.02)  # [s]
RATE, ROWS, NOISE = 25.0, 1000, 1e-4  # rows a second; rows; [m]
SPEED = 1.65  # [rad/s], of the fastest joint


def world(robot: str, late: float, seed: int) -> tuple[Samples, np.ndarray, np.ndarray]:
    """A log with late positions, and joints and true positions to test at."""
    arm, rng = calib.load_arm(robot), np.random.default_rng(seed)
    t = np.arange(ROWS) / RATE
    middle, half = (arm.lower + arm.upper) / 2, np.minimum((arm.upper - arm.lower) / 2.2, 1.5)
    pace, phase = rng.uniform(0.3, 1.0, (arm.dof, 3)), rng.uniform(0, 2 * np.pi, (arm.dof, 3))
    share = rng.dirichlet(np.ones(3), arm.dof)

    def along(t: np.ndarray, times: float) -> np.ndarray:
        waves = np.sin(times * t[:, None, None] * pace + phase)
        return middle + half * (share * waves).sum(axis=2)

    times = SPEED / np.abs(np.gradient(along(t, 1.0), t, axis=0)).max()
    offset = rng.normal(0.0, np.radians(0.2), arm.dof)
    x = arm.forward(along(t - late, times) + offset)
    x = x + rng.normal(0.0, NOISE, x.shape)
    known = (arm.joint_names, arm.lower, arm.upper, arm.revolute)
    log = Samples(along(t, times), x, *known, arm=arm, time=t)
    q = along(rng.uniform(t[0], t[-1], 2000), times)
    return log, q, arm.forward(q + offset)


def clocks(quick: bool) -> Iterator[Row]:
    """Errors and coverage for each arm and delay, the worst of some seeds."""
    for robot in ("two_link", "three_link", "spatial_three", "six_axis"):
        for late in LATE:
            errors, covered = [], []
            for seed in range(1 if quick else 3):
                log, q, truth = world(robot, late, seed)
                model = calib.train(log)
                error = np.linalg.norm(model.forward(q) - truth, axis=1)
                known = np.isfinite(error)
                errors.append(1e3 * float(error[known].mean()))
                covered.append(float(np.mean(error[known] <= model.expected_error(q[known]))))
            case = f"{robot}, positions {1e3 * late:+.0f} ms late"
            yield row(case, max(errors), "mm", most=0.27)
            yield row(f"{case}: bound covers", 100 * min(covered), "%", least=90.0)
