"""Honesty where the truth is known: paths, cameras, clocks."""

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from honest_worlds import (
    LENGTHS,
    Row,
    distance,
    image,
    nearly_nominal,
    route,
    row,
    samples,
    tip,
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


def _camera_truth(dof: int, seed: int) -> tuple[Array, Array, Any]:
    """Limits of the logged joints and where the tip is in the image."""
    rng = np.random.default_rng(seed)
    lower, upper = np.full(dof, -1.2), np.full(dof, 1.2)
    lower[0], upper[0] = 0.0, 1.5
    sense, offset = np.ones(dof), np.zeros(dof)
    turned_joint = int(rng.integers(1, dof))
    sense[turned_joint] = -1.0
    offset[turned_joint] = np.radians(7.0)
    bent = np.zeros(dof)
    bent[1] = 1.3

    def truth(q: Array) -> Array:
        return image(tip(sense * (q + offset) + bent, LENGTHS[dof]))

    return lower, upper, truth


def _own_least_squares(q: Array, x: Array, dof: int, truth: Any, asked: Array) -> float:
    """Mean miss [px] of the same class, fitted by SciPy from a start beside the truth."""
    from scipy.optimize import least_squares

    best = np.inf
    error = np.nan
    for senses in np.array(np.meshgrid(*([[1.0, -1.0]] * (dof - 1)))).T.reshape(-1, dof - 1):
        sense = np.concatenate([[1.0], senses])

        def chain(theta: Array, joints: Array, sense: Array = sense) -> Array:
            lengths = np.concatenate([[0.3], theta[: dof - 1]])
            p = tip(sense * joints + np.concatenate([[0.0], theta[dof - 1 : 2 * dof - 2]]), lengths)
            h = theta[2 * dof - 2 :]
            w = 1.0 + p @ h[6:]
            return (p @ h[:4].reshape(2, 2).T + h[4:6]) / w[:, None]

        for first in (1.3, -1.3, 0.5):
            start = np.concatenate(
                [LENGTHS[dof][1:], [first], np.zeros(dof - 2), [750, 0, 0, -700, 530, 500, 0, 0]]
            )
            fit = least_squares(
                lambda t: (chain(t, q) - x).ravel(), start, x_scale=np.maximum(np.abs(start), 0.1)
            )
            if fit.cost < best:
                best = fit.cost
                error = float(distance(chain(fit.x, asked), truth(asked)).mean())
    return error


def camera(quick: bool) -> Iterator[Row]:
    """Few rows of a tilted camera, commanded in whole degrees, one servo reversed."""
    shares, signs = [], []
    for dof in (2, 3):
        for n in (20, 40, 100):
            ours, theirs = [], []
            for seed in range(2 if quick else 10):
                lower, upper, truth = _camera_truth(dof, 40 + seed)
                rng = np.random.default_rng(80 + seed)
                q = np.radians(np.round(np.degrees(rng.uniform(lower, upper, (n, dof)))))
                x = truth(q) + rng.standard_normal((n, 2))
                asked = rng.uniform(lower, upper, (600, dof))
                model = calib.train(samples(q, x, lower, upper, unit="px"))
                miss, bound = distance(model.forward(asked), truth(asked)), model.model_error(asked)
                known = np.isfinite(miss) & np.isfinite(bound)
                shares.append(float(np.mean(miss[known] <= bound[known])) if known.any() else 1.0)
                ours.append(float(miss[known].mean()) if known.any() else np.nan)
                theirs.append(_own_least_squares(q, x, dof, truth, asked))
                signs.append(_sign_right(model, dof, 40 + seed))
            yield row(
                f"camera, {dof} joints, {n} rows: error / own least squares",
                float(np.mean(ours) / np.mean(theirs)),
                most=1.2,
                more=f"{np.mean(ours):.3g} and {np.mean(theirs):.3g} px",
            )
    yield row(
        "camera: coverage of the true position",
        100 * float(np.mean(shares)),
        "%",
        least=93,
        more=f"least {100 * min(shares):.0f}",
    )
    yield row(
        f"camera: reversed servo found, of {len(signs)}",
        100 * float(np.mean(signs)),
        "%",
        least=100,
    )


def _sign_right(model: calib.Model, dof: int, seed: int) -> bool:
    """Whether the body turns the joints as they turn, up to a mirror of all of them."""
    rng = np.random.default_rng(seed)
    sense = np.ones(dof)
    sense[int(rng.integers(1, dof))] = -1.0
    found = np.asarray(model.body.structure.signs, dtype=float)
    return bool(np.array_equal(found * found[0], sense))


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
