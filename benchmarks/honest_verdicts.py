"""Honesty of verdicts and monitors: repeated and few rows, other sessions, play, streams."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from honest_change import adapted
from honest_real import SERIES, halves, series
from honest_worlds import LENGTHS, Row, distance, image, row, samples, tip

import calib

Array = Any

NOISE = 2e-4
"""Of the simulated logs [m]."""


def _bare(robot: str, n: int, seed: int, *changes: str) -> calib.Samples:
    """A log of an arm that no simulation is known of."""
    log = calib.babble(calib.load_arm(robot), n, noise=NOISE, seed=seed, changes=list(changes))
    return replace(log, simulation=None)


def repeats(quick: bool) -> Iterator[Row]:
    """Rows that are written twice: the same model, and the same promise."""
    for robot, n in (("two_link", 20), ("six_axis", 40)):
        arm = calib.load_arm(robot)
        q = np.random.default_rng(9).uniform(arm.lower, arm.upper, (500, arm.dof))
        covered, ratios = [], []
        for seed in range(2 if quick else 10):
            log = _bare(robot, n, 30 + seed)
            once = calib.train(log, size=6)
            twice = calib.train(log.take(np.tile(np.arange(n), 2)), size=6)
            bound = twice.model_error(q)
            covered.append(np.mean(distance(twice.forward(q), arm.forward(q)) <= bound))
            ratios.append(np.median(bound) / np.median(once.model_error(q)))
        case = f"{robot}, {n} rows written twice"
        yield row(f"{case}: coverage", 100 * float(np.mean(covered)), "%", least=90)
        yield row(f"{case}: bound over that of once", float(np.min(ratios)), least=0.9)


def few_rows(quick: bool) -> Iterator[Row]:
    """Changed logs of 10 to 14 rows that are called still calibrated, or that a model fits."""
    changes = {
        "two_link": ("elbow.offset=0.0052", "tip.offset=0.0015,0"),
        "six_axis": ("elbow.offset=0.0052", "wrist_1.length=+3%"),
    }
    for robot, kinds in changes.items():
        model = calib.train(_bare(robot, 400, 7), size=6)
        calm = wrong = fits = silent = count = 0
        for n in (10, 12, 14):
            for seed in range(2 if quick else 12):
                silent += calib.check(model, _bare(robot, n, 200 + seed)).drifted is None
                calm += calib.check(model, _bare(robot, n, 200 + seed)).drifted is True
                for change in kinds:
                    log = _bare(robot, n, 300 + seed, change)
                    wrong += calib.check(model, log).drifted is False
                    fits += calib.recognise([model], log).index is not None
                    count += 1
        case = f"{robot}, 10 to 14 rows"
        yield row(f"{case}, changed: still calibrated, of {count}", wrong, most=0)
        yield row(f"{case}, changed: recognised, of {count}", fits, most=0)
        more = f"too few rows to say in {silent} of {count // 2}"
        yield row(f"{case}, unchanged: drifted, of {count // 2}", calm, most=0, more=more)


def sessions(folder: Path, quick: bool) -> Iterator[Row]:
    """Windows of one series under a model of the other: calm where the bound fails, and harm."""
    a, c = (series(folder, name) for name in SERIES)
    lower, upper = np.minimum(a.lower, c.lower), np.maximum(a.upper, c.upper)
    a, c = (replace(log, lower=lower, upper=upper) for log in (a, c))
    ratios: list[float] = []
    calm = failing = count = 0
    for learned, asked in ((a, c), (c, a)):
        model = calib.train(learned)
        for n in (12, 40, 150) if quick else (12, 20, 30, 40, 60, 100, 150):
            for place in range(0, 10, 3) if quick else range(10):
                start = (len(asked) - n) * place // 9
                window = asked.take(np.arange(start, start + n))
                verdict = calib.check(model, window)
                contradicted = verdict.covered < 0.8
                failing += contradicted
                calm += contradicted and verdict.words == "still calibrated"
                ratios.append(adapted(model, asked, n, place, same=False, every=3).ratio)
                count += 1
    print(file=sys.stderr)
    more = f"covers less than 80 % in {failing}"
    case = f"windows of another session, of {count}: calm where the bound fails"
    yield row(case, calm, most=0, more=more)
    yield row("the same: worst error after / before", max(ratios), most=1.12)
    yield row("the same: mean error after / before", float(np.mean(ratios)), most=0.75)


def approach(quick: bool) -> Iterator[Row]:
    """Fresh logs of an arm whose play was learned: drifted, adapted, and rows left out."""
    for robot, joint in (("two_link", "elbow"), ("three_link", "shoulder")):
        play = f"{joint}.backlash=0.02"
        model = calib.train(_bare(robot, 1000, 0, play), size=6)
        drifted = improved = left_out = 0
        seeds = range(2 if quick else 8)
        for seed in seeds:
            log = _bare(robot, 200, 100 + seed, play)
            drifted += bool(calib.check(model, log).drifted)
            found = calib.adapt(model, log)
            improved += found.improved
            left_out += found.left_out
        case = f"{robot}, play of 20 mrad learned, {len(seeds)} fresh logs"
        yield row(f"{case}: drifted", drifted, most=0)
        yield row(f"{case}: adapted", improved, most=0, more=f"{left_out} rows left out")


STREAM_NOISE = 1e-3
CHANGES = {
    "elbow encoder 1 deg": "elbow.offset=0.0174533",
    "elbow link +5 %": "elbow.length=+5%",
    "sensor 5 mm": "sensor.shift=0.005,0",
}


def first_alarm(monitor: calib.Monitor, q: Array, x: Array) -> int | None:
    """Samples until the first alarm, None without one."""
    found = (k for k, row in enumerate(zip(q, x, strict=True), 1) if monitor.update(*row).drifted)
    return next(found, None)


def poses(kind: str, lower: Array, upper: Array, n: int, seed: int) -> Array:
    """Joints (n, dof) at random, along lines of 100 samples, or dwelling for 250."""
    rng = np.random.default_rng(seed)
    if kind == "random":
        return rng.uniform(lower, upper, (n, len(lower)))
    each = 100 if kind == "path" else 250
    goals = rng.uniform(lower, upper, (n // each + 2, len(lower)))
    if kind == "dwell":
        near = rng.normal(0.0, 0.005, (n, len(lower))) * (upper - lower)
        return np.clip(goals[np.arange(n) // each] + near, lower, upper)
    at = np.arange(n) / each
    return np.stack([np.interp(at, np.arange(len(goals)), goal) for goal in goals.T], axis=1)


def streams(quick: bool) -> Iterator[Row]:
    """Models of logs without a known simulation: calm streams, and changes after 400 samples."""
    alarms = []
    for name in ("two_link", "three_link"):
        arm = calib.load_arm(name)
        for rows in (100, 1000):
            model = _of_log(calib.babble(arm, rows, seed=3, noise=STREAM_NOISE))
            for kind in ("random", "path", "dwell"):
                q = poses(kind, arm.lower, arm.upper, 2_000 if quick else 10_000, rows)
                x = tip(q, LENGTHS[arm.dof])
                x = x + np.random.default_rng(rows).normal(0.0, STREAM_NOISE, x.shape)
                alarms.append(first_alarm(calib.monitor(model), q, x) is not None)
            yield from _delays(f"{name}, model of {rows} rows", arm, model, 4 if quick else 8)
    arm = calib.load_arm("six_axis")
    for rows in (300, 1000):
        model = _of_log(calib.babble(arm, rows, seed=3, noise=STREAM_NOISE))
        yield from _delays(f"six_axis, model of {rows} rows", arm, model, 3, space=True)
    yield from _pixels()
    yield row(f"calm planar streams with an alarm, of {len(alarms)}", float(sum(alarms)), most=0)


def real_streams(folder: Path, quick: bool) -> Iterator[Row]:
    """Halves of A and C, each watched with the model of the other."""
    alarms = []
    for name in SERIES:
        log = series(folder, name)
        for learned, asked in halves(len(log), 2)[: 1 if quick else 2]:
            monitor, rows = calib.monitor(calib.train(log.take(learned))), log.take(asked)
            alarms.append(first_alarm(monitor, rows.q, rows.x) is not None)
    yield row(f"halves of A and C with an alarm, of {len(alarms)}", float(sum(alarms)), most=0)


def _of_log(log: calib.Samples) -> calib.Model:
    return calib.train(replace(log, simulation=None), size=20)


def _delays(
    what: str, arm: Any, model: calib.Model, seeds: int, space: bool = False
) -> Iterator[Row]:
    for change, words in CHANGES.items():
        if space and words.startswith("sensor"):
            continue
        waits, early = [], 0
        for seed in range(seeds):
            monitor = calib.monitor(model)
            calm = calib.babble(arm, 400, seed=100 + seed, noise=STREAM_NOISE)
            early += first_alarm(monitor, calm.q, calm.x) is not None
            new = calib.babble(arm, 400, seed=200 + seed, noise=STREAM_NOISE, changes=[words])
            waits.append(first_alarm(monitor, new.q, new.x) or len(new.q) + 1)
        yield row(
            f"{what}: {change}, samples to the alarm, median",
            float(np.median(waits)),
            most=200,
            more=f"slowest {max(waits)}, {early} of {seeds} alarms before",
        )


def _pixels() -> Iterator[Row]:
    """A tilted camera, 1 px of noise: a calm stream, then an elbow of 1 deg more."""
    lower, upper = np.radians([0.0, 15.0]), np.radians([90.0, 150.0])
    rng = np.random.default_rng(0)

    def seen(q: Array) -> Array:
        return image(tip(q, LENGTHS[2])) + rng.normal(0.0, 1.0, (len(q), 2))

    q = poses("random", lower, upper, 300, 1)
    monitor = calib.monitor(_of_log(samples(q, seen(q), lower, upper, unit="px")))
    calm = poses("random", lower, upper, 2_000, 2)
    early = first_alarm(monitor, calm, seen(calm)) is not None
    new = poses("random", lower, upper, 400, 3)
    wait = first_alarm(monitor, new, seen(new + np.radians([0.0, 1.0]))) or len(new) + 1
    yield row(
        "pixels, model of 300 rows: elbow 1 deg, samples to the alarm",
        float(wait),
        most=200,
        more=f"{int(early)} alarms in 2,000 calm samples before",
    )
