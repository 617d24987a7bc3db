"""Planned poses against random ones: accuracy and travel.

    python benchmarks/plan.py [--quick]

Prints the tables of docs/plan.md.  Everything is simulated with 1 mm noise per axis and fixed
seeds.  What a log tells is measured by the model that is trained on it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc
from tables import table, typed

import calib
from calib.samples.simulation import Simulation, parse_changes

Array = NDArray[np.float64]
Design = Callable[[calib.PlanarArm, int, int], Array]

NOISE = 1e-3  # of the sensor, per axis [m]


def uniform(arm: calib.PlanarArm, n: int, seed: int) -> Array:
    """Random babbling."""
    return calib.babble(arm, n, seed=seed).q


def sobol(arm: calib.PlanarArm, n: int, seed: int) -> Array:
    """Sobol's sequence, shifted at random."""
    points = qmc.Sobol(arm.dof, scramble=False).random_base2((n - 1).bit_length())[:n]
    u = (points + np.random.default_rng(seed).random(arm.dof)) % 1.0
    return arm.lower + (arm.upper - arm.lower) * u


def planned(arm: calib.PlanarArm, n: int, seed: int) -> Array:
    """What `calib plan` writes."""
    return calib.plan(arm, n, seed=seed).q


DESIGNS: dict[str, Design] = {
    "random": uniform,
    "Sobol": sobol,
    "calib plan": planned,
}


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
            row = {"design": name}
            for n in counts:
                found = np.array(
                    [errors(arm, measure(arm, design(arm, n, s), s)) for s in range(seeds)]
                )
                mean, p99 = found.mean(axis=0)
                row[f"{n} poses"] = f"{mean:.2f} ({found[:, 0].max():.2f}), {p99:.1f}"
            rows.append(row)
        table(f"{robot}: mean error [mm] over {seeds} seeds (worst seed), 99 % quantile", rows)
    rows = []
    for robot in ("two_link", "three_link", "polar"):
        arm = calib.load_arm(robot)
        row = {"robot": robot}
        for n in (30, 60, 100):
            plans = [calib.plan(arm, n, seed=s) for s in range(seeds)]
            own = np.mean([plan.length for plan in plans])
            other = np.mean([random_length(arm, plan) for plan in plans])
            row[f"{n} poses"] = f"{own:.1f} against {other:.1f} ({100 * own / other:.0f} %)"
        rows.append(row)
    table("travel, in ranges of the joint that moves most, against a random order", rows)


def random_length(arm: calib.PlanarArm, plan: calib.Plan) -> float:
    """Length of the way through the same poses in a random order."""
    span = arm.upper - arm.lower
    q = np.random.default_rng(0).permutation(plan.q)
    moves = np.abs(np.diff(np.vstack([plan.start, q]), axis=0)) / span
    return float(moves.max(axis=1).sum())


def main() -> None:
    """Print the tables."""
    spread(3 if typed(__doc__, quick=False).quick else 20)


if __name__ == "__main__":
    main()
