"""Plan poses, measure them, train; later plan a check, and re-calibrate after a knock.

    python examples/measure_plan.py

The arm and the tracker are simulated here, with 1 mm noise.  With an arm of your own, replace
`measured`: drive to each row of `plan.q`, wait until the arm stands still, and read the
tracker.  Self-collision and obstacles are yours to watch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import calib


def measured(
    arm: calib.PlanarArm, q: np.ndarray, seed: int, changes: Sequence[str] = ()
) -> calib.Samples:
    """Drive the simulated arm to the poses and read its noisy tracker."""
    log = calib.babble(arm, len(q), noise=1e-3, changes=changes)
    simulation = log.simulation
    assert simulation is not None
    x = simulation.measure(q, np.random.default_rng(seed))
    return replace(log, q=q, x=x, simulation=None)


def error(model: calib.Model, log: calib.Samples) -> float:
    """Mean distance between predicted and measured positions [mm]."""
    return 1e3 * float(np.linalg.norm(model.forward(log.q) - log.x, axis=1).mean())


def main() -> None:
    """Measure, train, check, adapt."""
    arm = calib.load_arm("two_link")

    first = calib.plan(arm, 60)
    for line in first.why:
        print(line)
    print(f"travel: {first.length:.1f} ranges of the joint that moves most")
    first.write("poses.csv")
    model = calib.train(measured(arm, first.q, 1), size=10)
    truth = replace(calib.babble(arm, 2000, seed=5), simulation=None)
    print(f"learned from 60 poses: {error(model, truth):.2f} mm")

    # a knock: the forearm's encoder slips by one degree
    knock = ["elbow.offset=0.0175"]
    few = calib.plan(model, 20)
    seen = measured(arm, few.q, 2, knock)
    drift = calib.check(model, seen)
    print(f"drifted: {drift.drifted}, causes: {', '.join(cause.words for cause in drift.causes)}")
    adapted = calib.adapt(model, seen).model
    now = replace(truth, x=calib.babble(arm, 2000, seed=5, changes=knock).x)
    print(f"after the knock: {error(model, now):.2f} -> {error(adapted, now):.2f} mm")


if __name__ == "__main__":
    main()
