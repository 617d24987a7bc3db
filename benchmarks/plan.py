"""Planned poses against random ones: accuracy, travel, and what a check finds.

    python benchmarks/plan.py [--quick] [--only spread more check adapt]

Prints the tables of docs/plan.md.  Everything is simulated with 1 mm noise per axis and fixed
seeds.  What a log tells is measured by the model that is trained on it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc
from tables import table

import calib
from calib.samples.changes import parse_changes
from calib.samples.simulation import Simulation

Array = NDArray[np.float64]
Design = Callable[[calib.PlanarArm, int, int], Array]

NOISE = 1e-3  # of the sensor, per axis [m]
FOUND = {
    "no change": ([], set()),
    "shoulder link +1 %": (["shoulder.length=+1%"], {"length:shoulder"}),
    "elbow link +1 %": (["elbow.length=+1%"], {"length:elbow"}),
    "elbow encoder 0.4 deg": (["elbow.offset=0.007"], {"offset:elbow"}),
    "camera turned 0.3 deg": (["sensor.rotate=0.0052"], {"sensor", "offset:shoulder"}),
    "camera shifted 1.5 mm": (["sensor.shift=0.0015,0"], {"sensor"}),
    "shoulder link +3 %": (["shoulder.length=+3%"], {"length:shoulder"}),
    "elbow link +3 %": (["elbow.length=+3%"], {"length:elbow"}),
    "elbow encoder 1.2 deg": (["elbow.offset=0.021"], {"offset:elbow"}),
}
MENDED = {
    "elbow link +5 %": ["elbow.length=+5%"],
    "encoders 3, -2 deg": ["shoulder.offset=0.0523599", "elbow.offset=-0.0349066"],
    "camera 8 deg, 30 mm, 1.05": [
        "sensor.rotate=0.139626",
        "sensor.shift=0.03,0",
        "sensor.scale=1.05",
    ],
}


def uniform(arm: calib.PlanarArm, n: int, seed: int) -> Array:
    """Random babbling."""
    return calib.babble(arm, n, seed=seed).q


def sobol(arm: calib.PlanarArm, n: int, seed: int) -> Array:
    """Sobol's sequence, shifted at random."""
    return calib.babble(arm, n, seed=seed, method="sobol").q


def halton(arm: calib.PlanarArm, n: int, seed: int) -> Array:
    """Halton's sequence, crowded towards the limits as Chebyshev's nodes are."""
    points = qmc.Halton(arm.dof, scramble=False).random(n)
    u = (points + np.random.default_rng(seed).random(arm.dof)) % 1.0
    return arm.lower + (arm.upper - arm.lower) * (0.5 - 0.5 * np.cos(np.pi * u))


def planned(arm: calib.PlanarArm, n: int, seed: int) -> Array:
    """What `calib plan` writes."""
    return calib.plan(arm, n, seed=seed).q


DESIGNS: dict[str, Design] = {
    "random": uniform,
    "Sobol": sobol,
    "Halton, crowded": halton,
    "calib plan": planned,
}
PAIR = {name: DESIGNS[name] for name in ("random", "calib plan")}


def measure(
    arm: calib.PlanarArm, q: Array, seed: int, changes: Sequence[str] = ()
) -> calib.Samples:
    """What the sensor reads at the poses."""
    simulation = Simulation(arm, NOISE, parse_changes(changes))
    x = simulation.measure(q, np.random.default_rng([seed, 1]))
    return replace(calib.babble(arm, len(q)), q=q, x=x, simulation=None)


def errors(arm: calib.PlanarArm, log: calib.Samples) -> tuple[float, float]:
    """Mean and 99 % quantile of the error all over the joints' ranges [mm]."""
    model = calib.train(replace(log, arm=None, lower=arm.lower, upper=arm.upper), size=8)
    q = np.random.default_rng(99).uniform(arm.lower, arm.upper, (4000, arm.dof))
    gap = 1e3 * np.linalg.norm(model.forward(q) - arm.forward(q), axis=1)
    return float(gap.mean()), float(np.quantile(gap, 0.99))


def spread(seeds: int) -> None:
    """Error by design and number of poses."""
    for robot, counts in (("two_link", (30, 60, 100)), ("three_link", (60, 100)), ("polar", (60,))):
        arm = calib.load_arm(robot)
        rows = []
        for name, design in DESIGNS.items():
            row = [name]
            for n in counts:
                found = np.array(
                    [errors(arm, measure(arm, design(arm, n, s), s)) for s in range(seeds)]
                )
                mean, p99 = found.mean(axis=0)
                row.append(f"{mean:.2f} ({found[:, 0].max():.2f}), {p99:.1f}")
            rows.append(row)
            print(robot, row, file=sys.stderr, flush=True)
        print(f"{robot}: mean error [mm] over {seeds} seeds (worst seed), 99 % quantile\n")
        table(
            "",
            [
                dict(zip(["design", *(f"{n} poses" for n in counts)], row, strict=True))
                for row in rows
            ],
        )
    rows = []
    for robot in ("two_link", "three_link", "polar"):
        arm = calib.load_arm(robot)
        row = [robot]
        for n in (30, 60, 100):
            plans = [calib.plan(arm, n, seed=s) for s in range(seeds)]
            own, other = (
                np.mean([getattr(p, name) for p in plans]) for name in ("length", "random_length")
            )
            row.append(f"{own:.1f} against {other:.1f} ({100 * own / other:.0f} %)")
        rows.append(row)
    print("travel, in ranges of the joint that moves most, against a random order\n")
    table(
        "",
        [
            dict(zip(["robot", "30 poses", "60 poses", "100 poses"], row, strict=True))
            for row in rows
        ],
    )


def more(seeds: int) -> None:
    """Error after adding 30 poses to 60."""
    arm = calib.load_arm("two_link")
    rows = []
    for name in ("spread over the ranges", "crowded in a corner"):
        found: dict[str, list[tuple[float, float]]] = {}
        for s in range(seeds):
            rng = np.random.default_rng([s, 7])
            u = rng.random((60, 2)) if name.startswith("spread") else rng.beta(1.2, 3.0, (60, 2))
            log = measure(arm, arm.lower + u * (arm.upper - arm.lower), s)
            further = {
                "60 rows": None,
                "+ 30 random": uniform(arm, 30, s + 1000),
                "+ 30 planned": planned(arm, 30, s),
                "+ 30 planned with --data": calib.plan(arm, 30, seed=s, measured=log).q,
            }
            for what, q in further.items():
                both = log
                if q is not None:
                    new = measure(arm, q, s + 500)
                    both = replace(log, q=np.vstack([log.q, new.q]), x=np.vstack([log.x, new.x]))
                found.setdefault(what, []).append(errors(arm, both))
        means = {what: np.mean(pairs, axis=0) for what, pairs in found.items()}
        rows.append([name, *(f"{mean:.2f}, {p99:.1f}" for mean, p99 in means.values())])
    print(f"two_link: mean error [mm] over {seeds} seeds, 99 % quantile\n")
    table("", [dict(zip(["60 random rows", *found], row, strict=True)) for row in rows])


def check(seeds: int) -> None:
    """What a check of 20 poses finds."""
    arm, model = knocked()
    calm = 5 * seeds  # false alarms are rare
    rows = []
    for change, (texts, true) in FOUND.items():
        row = [change]
        for design in PAIR.values():
            some = range(seeds if true else calm)
            drifts = [calib.check(model, measure(arm, design(arm, 20, s), s, texts)) for s in some]
            named = [{c.cause for c in d.causes} - {"noise", "workspace"} for d in drifts]
            right = sum(bool(names) and names <= true for names in named)
            found = sum(d.drifted for d in drifts)
            row.append(f"{found}, {right}" if true else f"{found} of {calm}")
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
    print(f"two_link: of {seeds} checks of 20 poses how many find a drift, and name it alone\n")
    table("", [dict(zip(["change", *PAIR], row, strict=True)) for row in rows])


def adapt(seeds: int) -> None:
    """Error after a re-calibration with 20 poses."""
    arm, model = knocked()
    q = np.random.default_rng(99).uniform(arm.lower, arm.upper, (2000, 2))
    rows = []
    for change, texts in MENDED.items():
        truth = Simulation(arm, changes=parse_changes(texts)).exact(q)
        row = [change]
        for design in PAIR.values():
            left = []
            for s in range(seeds):
                log = measure(arm, design(arm, 20, s), s, texts)
                adapted = calib.adapt(model, log).model
                left.append(1e3 * np.linalg.norm(adapted.forward(q) - truth, axis=1).mean())
            row.append(f"{np.mean(left):.2f} ({max(left):.2f})")
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
    print(f"two_link: mean error [mm] of the correction over {seeds} seeds (worst seed)\n")
    table("", [dict(zip(["change", *PAIR], row, strict=True)) for row in rows])


def knocked() -> tuple[calib.PlanarArm, calib.Model]:
    """The arm, and a model of how it was before the changes."""
    arm = calib.load_arm("two_link")
    return arm, calib.train(calib.babble(arm, 20_000, seed=0, noise=NOISE), size=40)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="3 seeds instead of 20")
    parts: dict[str, Callable[[int], None]] = {
        "spread": spread,
        "more": more,
        "check": check,
        "adapt": adapt,
    }
    parser.add_argument("--only", nargs="+", choices=parts, default=list(parts))
    options = parser.parse_args()
    for name in options.only:
        seeds = 3 if options.quick else 20
        parts[name](seeds)


if __name__ == "__main__":
    main()
