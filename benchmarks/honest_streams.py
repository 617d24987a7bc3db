"""Honesty of the monitor: calm streams, real halves, and samples until a change is seen."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from honest_real import SERIES, halves, series
from honest_worlds import LENGTHS, Row, image, row, samples, tip

import calib

Array = Any

NOISE = 1e-3
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
            model = _of_log(calib.babble(arm, rows, seed=3, noise=NOISE))
            for kind in ("random", "path", "dwell"):
                q = poses(kind, arm.lower, arm.upper, 2_000 if quick else 10_000, rows)
                x = tip(q, LENGTHS[arm.dof])
                x = x + np.random.default_rng(rows).normal(0.0, NOISE, x.shape)
                alarms.append(first_alarm(calib.monitor(model), q, x) is not None)
            yield from _delays(f"{name}, model of {rows} rows", arm, model, 4 if quick else 8)
    arm = calib.load_arm("six_axis")
    for rows in (300, 1000):
        model = _of_log(calib.babble(arm, rows, seed=3, noise=NOISE))
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
            calm = calib.babble(arm, 400, seed=100 + seed, noise=NOISE)
            early += first_alarm(monitor, calm.q, calm.x) is not None
            new = calib.babble(arm, 400, seed=200 + seed, noise=NOISE, changes=[words])
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
