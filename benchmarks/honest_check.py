"""Honesty of `check`: alarms, power, noisier encoders; paths and clocks of a known truth."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from honest_real import SERIES, gap_splits, halves, nominal_urdf, series
from honest_worlds import LENGTHS, Row, distance, nearly_nominal, route, row, samples, tip

import calib


def checks(folder: Path, quick: bool) -> Iterator[Row]:
    """Alarms on unchanged rows: other halves, gaps, and contiguous pieces of either."""
    alarms, told = [], []
    for name in SERIES:
        log = series(folder, name)
        splits = [(f"{b} blocks", *s) for b in (2, 4, 10, 20) for s in halves(len(log), b)]
        splits += gap_splits(log)
        for what, learned, asked in splits[:: 4 if quick else 1]:
            model = calib.train(log.take(learned))
            pieces = [asked]
            if len(asked) > 800:
                pieces += [asked[:400], asked[-400:]]
            for piece in pieces:
                if len(np.unique(log.q[piece], axis=0)) < 10:
                    continue  # too few to judge by, and `check` says so
                alarms.append(bool(calib.check(model, log.take(piece)).drifted))
                if alarms[-1]:
                    told.append(f"{name} {what} {len(piece)} rows")
    yield row(
        f"alarms in {len(alarms)} unchanged halves, pieces and gaps",
        float(np.sum(alarms)),
        most=0,
        more="; ".join(told),
    )


@cache
def _noisy(n: int = 20_000) -> calib.Model:
    arm = calib.load_arm("two_link")
    return calib.train(calib.babble(arm, n, seed=0, noise=1e-3), size=70 if n > 9000 else 30)


def _power_log(change: str, seed: int) -> calib.Samples:
    """200 rows at 1 mm; "swapped" turns the elbow's sense, all else is typed as for babble."""
    arm = calib.load_arm("two_link")
    if change != "swapped":
        return calib.babble(arm, 200, seed=seed, noise=1e-3, changes=[change] if change else [])
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (200, 2))
    x = tip(q * [1.0, -1.0], LENGTHS[2]) + 1e-3 * rng.standard_normal((200, 2))
    return samples(q, x, arm.lower, arm.upper, arm=arm)


def _alarms(change: str, seeds: range) -> int:
    return sum(bool(calib.check(_noisy(), _power_log(change, 1000 + s)).drifted) for s in seeds)


def power(quick: bool) -> Iterator[Row]:
    """Alarms in 200 rows at 1 mm, and the smallest change found in 9 of 10 logs."""
    seeds = range(4 if quick else 20)
    degree = float(np.radians(1.0))
    cases = {
        "elbow link 5 %": "elbow.length=+5%",
        "shoulder link 5 %": "shoulder.length=+5%",
        "elbow offset 1 deg": f"elbow.offset={degree!r}",
        "camera turned 1 deg": f"sensor.rotate={degree!r}",
        "camera mirrored": "sensor.mirror=x",
        "elbow's sign swapped": "swapped",
    }
    for name, change in cases.items():
        yield row(
            f"power, {name}: alarms in {len(seeds)}", _alarms(change, seeds), least=len(seeds)
        )
    calm = range(20 if quick else 100)
    yield row(
        f"nothing changed: alarms in {len(calm)}", _alarms("", calm), most=len(calm) // 100 + 1
    )
    kinds = {
        ("elbow link", "mm", 0.6): lambda v: f"elbow.length={0.25 + 1e-3 * v:.6f}",
        ("camera shifted", "mm", 0.6): lambda v: f"sensor.shift={1e-3 * v:.6f},0",
        ("elbow offset", "deg", 0.15): lambda v: f"elbow.offset={float(np.radians(v))!r}",
        ("camera turned", "deg", 0.08): lambda v: f"sensor.rotate={float(np.radians(v))!r}",
    }
    for (name, unit, most), change in kinds.items():
        found = [
            v
            for v in (0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2)
            if v <= 1.01 * most and _alarms(change(v), seeds) >= 0.9 * len(seeds)
        ]
        yield row(
            f"smallest found in 9 of 10, {name}", min(found, default=float("nan")), unit, most=most
        )


NOISE = 1e-4  # of the logs that models are learned from [m]


def noisier(quick: bool) -> Iterator[Row]:
    """Logs of 10 to 30 rows that are called drifted, by how much noisier the sensor is."""
    seeds = range(1000, 1005 if quick else 1020)
    for robot in ("two_link", "three_link"):
        arm = calib.load_arm(robot)
        model = calib.train(_logged(arm, 400, 77, NOISE), size=8)
        for factor in (1, 2, 5, 10):
            logs = [_logged(arm, n, s, factor * NOISE) for n in (10, 15, 20, 30) for s in seeds]
            alarms = sum(bool(calib.check(model, log).drifted) for log in logs)
            case = f"{robot}, noise {factor} times: drifted, of {len(logs)} logs"
            yield row(case, alarms, most=0.02 * len(logs))


def encoders(quick: bool) -> Iterator[Row]:
    """Logs whose encoder is noisy: called drifted, and taken for a change by `adapt`."""
    seeds = range(2000, 2002 if quick else 2008)
    for robot in ("two_link", "three_link"):
        yield from _encoders(calib.load_arm(robot), (20, 40, 100), (0.001, 0.003, 0.01), seeds)


def space_encoders(quick: bool) -> Iterator[Row]:
    """The same of arms in space, 5 mrad."""
    for name in ("ur10_robot", "panda", "so101"):
        arm = calib.load_arm(nominal_urdf(name))
        yield from _encoders(arm, (40, 100), (0.005,), range(2000, 2001 if quick else 2004))


def _encoders(
    arm: Any, rows: tuple[int, ...], sizes: tuple[float, ...], seeds: range
) -> Iterator[Row]:
    model = calib.train(_logged(arm, 400, 78, NOISE), size=8)
    alarms = adapted = named = count = 0
    for n, seed, joint, size in product(rows, seeds, arm.joint_names, sizes):
        log = _logged(arm, n, seed, NOISE, f"{joint}.noise={size}")
        found = calib.check(model, log)
        alarms += bool(found.drifted)
        named += any(cause.cause == f"noise:{joint}" for cause in found.causes)
        adapted += calib.adapt(model, log).improved
        count += 1
    case = f"{arm.name}, one noisy encoder: drifted, of {count} logs"
    yield row(case, alarms, most=0.02 * count, more=f"named in {named}")
    yield row(f"{arm.name}, the same: adapted", adapted, most=0)


def _logged(arm: Any, n: int, seed: int, noise: float, *changes: str) -> calib.Samples:
    log = calib.babble(arm, n, seed=seed, noise=noise, changes=list(changes))
    return replace(log, simulation=None)


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
