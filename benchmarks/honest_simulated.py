"""Honesty where the truth is known: paths, clocks."""

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from honest_worlds import (
    Row,
    distance,
    nearly_nominal,
    route,
    row,
    samples,
)

import calib

Array = Any


@cache
def _two_link() -> calib.PlanarArm:
    return calib.load_arm("two_link")


def paths(quick: bool) -> Iterator[Row]:
    """Logs along a path, asked over the whole box."""
    arm = _two_link()
    asked = np.random.default_rng(5).uniform(arm.lower, arm.upper, (1500, 2))
    inside, known_rows, total = 0, 0, 0
    errors: dict[str, list[float]] = {}
    least = (2.0, "")
    for kind in ("2", "3", "5", "circle"):
        for size, noise in ((0.0, 0.0), (0.0, 2e-4), (1e-3, 2e-4), (4e-3, 2e-4)):
            for seed in range(1 if quick else 4):
                rng = np.random.default_rng(700 + seed)
                truth = nearly_nominal(size, rng)
                q = route(kind, 600 if quick else 3000, rng)
                x = truth(q) + noise * rng.standard_normal(q.shape)
                model = calib.train(samples(q, x, arm.lower, arm.upper, arm=arm))
                miss, bound = distance(model.forward(asked), truth(asked)), model.model_error(asked)
                known = np.isfinite(miss) & np.isfinite(bound)
                covered = np.count_nonzero(miss[known] <= bound[known])
                share = covered / max(known.sum(), 1)
                least = min(least, (share, f"{kind}, waves {1e3 * size:g} mrad, noise {noise:g}"))
                inside, known_rows, total = inside + covered, known_rows + known.sum(), total + 1500
                if size == 0.0:
                    errors.setdefault(kind, []).append(1e3 * float(np.mean(miss[known])))
    answered = 100 * known_rows / total
    yield row(
        "logs along a path: coverage over the box",
        100 * inside / max(known_rows, 1),
        "%",
        least=95,
        more=f"answered {answered:.0f} %; least {100 * least[0]:.0f}: {least[1]}",
    )
    for kind, values in errors.items():
        yield row(
            f"the same in class, {kind} {'poses' if kind != 'circle' else 'path'}, miss",
            float(np.mean(values)),
            "mm",
            most=0.4 if kind == "2" else 0.1,
            more=f"worst seed {max(values):.3g}",
        )


LATE = (0.0, 0.005, 0.02, -0.02)  # [s]
RATE, ROWS, NOISE = 25.0, 1000, 1e-4  # rows a second; rows; [m]
SPEED = 1.65  # [rad/s], of the fastest joint


def late_world(robot: str, late: float, seed: int) -> tuple[calib.Samples, Array, Array]:
    """A log with late positions, and joints and true positions to test at."""
    arm, rng = calib.load_arm(robot), np.random.default_rng(seed)
    t = np.arange(ROWS) / RATE
    middle, half = (arm.lower + arm.upper) / 2, np.minimum((arm.upper - arm.lower) / 2.2, 1.5)
    pace, phase = rng.uniform(0.3, 1.0, (arm.dof, 3)), rng.uniform(0, 2 * np.pi, (arm.dof, 3))
    share = rng.dirichlet(np.ones(3), arm.dof)

    def along(t: Array, times: float) -> Array:
        waves = np.sin(times * t[:, None, None] * pace + phase)
        return middle + half * (share * waves).sum(axis=2)

    times = SPEED / np.abs(np.gradient(along(t, 1.0), t, axis=0)).max()
    offset = rng.normal(0.0, np.radians(0.2), arm.dof)
    x = arm.forward(along(t - late, times) + offset)
    x = x + rng.normal(0.0, NOISE, x.shape)
    known = (arm.joint_names, arm.lower, arm.upper, arm.revolute)
    log = calib.Samples(along(t, times), x, *known, arm=arm, time=t)
    q = along(rng.uniform(t[0], t[-1], 2000), times)
    return log, q, arm.forward(q + offset)


def clocks(quick: bool) -> Iterator[Row]:
    """Errors and coverage for each arm and delay, the worst of some seeds."""
    for robot in ("two_link", "three_link", "spatial_three", "six_axis"):
        for late in LATE:
            errors, covered = [], []
            for seed in range(1 if quick else 3):
                log, q, truth = late_world(robot, late, seed)
                model = calib.train(log)
                error = np.linalg.norm(model.forward(q) - truth, axis=1)
                known = np.isfinite(error)
                errors.append(1e3 * float(error[known].mean()))
                covered.append(float(np.mean(error[known] <= model.expected_error(q[known]))))
            case = f"{robot}, positions {1e3 * late:+.0f} ms late"
            yield row(case, max(errors), "mm", most=0.27)
            yield row(f"{case}: bound covers", 100 * min(covered), "%", least=90.0)
