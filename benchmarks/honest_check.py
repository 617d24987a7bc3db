"""Honesty of `check`: false alarms, power, and encoders and sensors that are noisier."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from honest_real import SERIES, gap_splits, halves, nominal_urdf, series
from honest_worlds import LENGTHS, Row, row, samples, tip

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
