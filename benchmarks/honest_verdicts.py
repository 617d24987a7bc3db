"""Honesty of verdicts: repeated rows, few rows, another session, a play that was learned."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from honest_change import adapted
from honest_real import SERIES, series
from honest_worlds import Row, distance, row

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
