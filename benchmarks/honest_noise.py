"""Noise is no drift: unchanged arms whose sensor, or one joint's encoder, has become noisier."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from honest_worlds import Row, row

import calib

NOISE = 1e-4  # of the logs that models are learned from [m]


def noisier(quick: bool) -> Iterator[Row]:
    """Logs of 10 to 30 rows that are called drifted, by how much noisier the sensor is."""
    seeds = range(1000, 1005 if quick else 1020)
    for robot in ("two_link", "three_link"):
        arm = calib.load_arm(robot)
        model = calib.train(_measured(arm, 400, 77, NOISE), size=8)
        for factor in (1, 2, 5, 10):
            logs = [_measured(arm, n, s, factor * NOISE) for n in (10, 15, 20, 30) for s in seeds]
            alarms = sum(bool(calib.check(model, log).drifted) for log in logs)
            case = f"{robot}, noise {factor} times: drifted, of {len(logs)} logs"
            yield row(case, alarms, most=0.02 * len(logs))


def encoders(quick: bool) -> Iterator[Row]:
    """Logs whose encoder is noisy: called drifted, and taken for a change by `adapt`."""
    for robot in ("two_link", "three_link"):
        arm = calib.load_arm(robot)
        model = calib.train(_measured(arm, 400, 78, NOISE), size=8)
        alarms = adapted = count = 0
        for n in (20, 40, 100):
            for seed in range(2000, 2002 if quick else 2008):
                for joint in arm.joint_names:
                    for size in (0.001, 0.003, 0.01):
                        log = _measured(arm, n, seed, NOISE, f"{joint}.noise={size}")
                        alarms += bool(calib.check(model, log).drifted)
                        adapted += calib.adapt(model, log).improved
                        count += 1
        most = 0.02 * count
        case = f"{robot}, one noisy encoder: drifted, of {count} logs"
        yield row(case, alarms, most=most)
        yield row(f"{robot}, the same: adapted", adapted, most=0)


def _measured(arm: Any, n: int, seed: int, noise: float, *changes: str) -> calib.Samples:
    log = calib.babble(arm, n, seed=seed, noise=noise, changes=list(changes))
    return replace(log, simulation=None)
