"""Ablation: what the maps are for, and where they do not help.

python benchmarks/ablation.py [--data FOLDER] [--quick] [--seed K] [--sides 20,40]

Everything that can be left out is left out in turn: the body, the local models (the body
alone), the training of the maps, their varying density.  ``docs/maps.md`` reads the table.
"""

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tables import table, typed
from untrained import UNTRAINED, untrained_pair

import calib
from calib.common.choices import MAP_READOUTS
from calib.common.parallel import one_blas_thread
from calib.common.scale import Scale
from calib.maps.association import Association
from calib.maps.local_models import NO_MODELS
from calib.maps.model_selection import select
from calib.maps.predictor import Predictor
from calib.training.fitted_log import FittedLog
from calib.training.maps import associate, misfit_around
from calib.training.options import TrainingOptions

Array = Any
Defect = tuple[Callable[[Array], Array], Callable[[Array], Array]]
"""Positions (n, 2) of joints (n, 2), and which of these lie in the defect."""

STREAM = 91  # of the points on which errors are measured


@dataclass(frozen=True, eq=False)
class Case:
    """A log and what is true of it."""

    name: str
    samples: calib.Samples  # what is learned from
    # (n, dof), (n, 2), joints and positions that were not learned
    q: Array
    x: Array
    defect: Array  # (n,), which of them lie in a defect


def bump(arm: Any) -> Defect:
    """The arm with a bump of 3 mm that depends on both joints, 1.5 deg wide."""

    def away(q: Array) -> Array:
        return np.linalg.norm(np.degrees(q) - (45.0, 80.0), axis=1) / 1.5

    def truth(q: Array) -> Array:
        high = 3e-3 * np.exp(-0.5 * away(q) ** 2)
        return arm.forward(q) + high[:, None] * np.array([0.8, -0.6])

    return truth, lambda q: away(q) < 2.0


def ripple(arm: Any) -> Defect:
    """The arm whose elbow is 1 deg off, 72 cycles a turn, from 60 to 75 deg."""
    low, high = np.radians([60.0, 75.0])

    def inside(q: Array) -> Array:
        return (q[:, 1] > low) & (q[:, 1] < high)

    def truth(q: Array) -> Array:
        moved = q.copy()
        moved[:, 1] += np.where(inside(q), np.radians(1.0) * np.sin(72 * (q[:, 1] - low)), 0.0)
        return arm.forward(moved)

    return truth, inside


def simulated(name: str, n: int, tested: int, seed: int) -> Case:
    """One of the simulated cases, `n` rows to learn from and `tested` ones to test on.

    name : {"exact", "bump", "ripple"}, an exact sensor, and the two defects with 0.2 mm of noise
    """
    shape = {"bump": bump, "ripple": ripple}.get(name)
    # an elbow that bends both ways gives most targets two branches
    arm = calib.load_arm("two_link" if shape else "two_link_full")
    truth, inside = shape(arm) if shape else (arm.forward, lambda q: np.zeros(len(q), dtype=bool))
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(STREAM,)))
    span = arm.upper - arm.lower
    q = arm.lower + span * rng.random((n, 2))
    fresh = arm.lower + span * rng.random((tested, 2))
    x = truth(q) + (2e-4 if shape else 0.0) * rng.standard_normal((n, 2))
    known = arm.joint_names, arm.lower, arm.upper, arm.revolute
    samples = calib.Samples(q, x, *known, arm=arm, plane=arm.plane)
    return Case(name, samples, fresh, truth(fresh), inside(fresh))


def measured(folder: Path, series: str, block: int, blocks: int) -> Case:
    """A series of a UR10 without one contiguous block of its rows, which is tested on."""
    path = folder / f"series_{series.lower()}.csv"
    samples = calib.read_log(path, joints=["shoulder_lift_joint", "elbow_joint"])
    held = np.array_split(np.arange(len(samples)), blocks)[block]
    some, rest = samples.take(np.setdiff1d(np.arange(len(samples)), held)), samples.take(held)
    return Case(f"UR10 {series}", some, rest.q, rest.x, np.zeros(len(held), dtype=bool))


NETWORKS = ("vdsom:residual", "vdsom", "vdsom:rho", "som", "gng", *UNTRAINED)
CASES = ("exact", "bump", "ripple")


@dataclass(frozen=True, eq=False)
class Ground:
    """What all networks of a case share: the unit box, the body, and where it is wrong."""

    scale: Scale
    log: FittedLog
    misfit: Array

    @staticmethod
    def of(case: Case, seed: int) -> "Ground":
        """Fit the body of a case."""
        samples = case.samples
        scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
        log = FittedLog.of(samples, TrainingOptions(seed=seed))
        return Ground(scale, log, misfit_around(log, scale.to_unit(log.samples.q)))


@dataclass(frozen=True, eq=False)
class Trained:
    """One network on one case."""

    association: Association  # maps and links that know where the body is wrong
    # ``local`` (the body and local models), ``body`` alone, and ``linear`` (no body)
    predictors: dict[str, Predictor]
    seconds: float  # training of both maps and their links [s]


def cases(quick: bool, seed: int, data: Path | None) -> Iterator[Case]:
    """Simulated cases, and two of five blocks of each real series."""
    rows, tested = (600, 500) if quick else (20_000, 5_000)
    for name in CASES:
        yield simulated(name, rows, tested, seed)
    for series, block in itertools.product("AC" if data else "", (1, 3)):
        yield measured(data, series, block, 5)


def train_on(ground: Ground, network: str, side: int, seed: int) -> Trained:
    """Train one network of side x side nodes on a case's log.

    The maps of a log learn from its rows alone here, without imagined samples, so that
    the networks differ by what they make of the same rows.
    """
    scale, log, misfit = ground.scale, ground.log, ground.misfit
    samples = log.samples
    u = scale.to_unit(samples.q)
    started = time.perf_counter()
    if network in UNTRAINED:
        pair = untrained_pair(network, scale, u, samples.x, side, seed)
    else:
        options = TrainingOptions(side, map=network, seed=seed)
        pair = associate(scale, u, samples.x, options, misfit)
    alone = pair
    seconds, motor = time.perf_counter() - started, pair.motor
    held, seen = u[log.rows], samples.x[log.rows]
    predictor, _ = select(motor, held, seen, log.body, log.fit.held_out)
    if misfit is not None and network == "vdsom:residual":  # without a body nothing tells that
        alone = associate(scale, u, samples.x, TrainingOptions(side, map=network, seed=seed))
    predictors = {
        "local": predictor,
        "body": Predictor(motor, log.body, NO_MODELS),
        "linear": Predictor(alone.motor, alone.linear, NO_MODELS),
    }
    return Trained(pair, predictors, seconds)


def measure(case: Case, trained: Trained) -> dict[str, float]:
    """Mean forward errors [mm] of a trained network, in a defect and elsewhere."""
    pair = trained.association
    u, figures = pair.motor.scale.to_unit(case.q), dict[str, float]()
    answers = {name: predictor.value(u) for name, predictor in trained.predictors.items()}
    for readout in MAP_READOUTS:
        if readout != "linear":  # that of the maps that stand alone is among the predictors
            answers[readout] = pair.sensory.scale.from_unit(pair.forward(u, readout))
    for name, answer in answers.items():
        error = 1e3 * np.linalg.norm(answer - case.x, axis=1)
        if case.defect.any():
            figures[f"{name} defect"] = float(error[case.defect].mean())
        figures[f"{name} elsewhere"] = float(error[~case.defect].mean())
    return figures | {"seconds": trained.seconds}


def main() -> None:
    """Print a table for each case: mean errors [mm], training [s]."""
    told = typed(__doc__, data=Path, quick=False, seed=0, sides=str)
    usual = "6,8" if told.quick else "10,20,40,70"
    sides = [int(side) for side in (told.sides or usual).split(",")]
    with one_blas_thread():
        blocks: dict[str, list[tuple[Case, Ground]]] = {}
        for case in cases(told.quick, told.seed, told.data):
            blocks.setdefault(case.name, []).append((case, Ground.of(case, told.seed)))
        for name, parts in blocks.items():
            rows = []
            for side, network in itertools.product(sides, NETWORKS):
                found = [measure(c, train_on(g, network, side, told.seed)) for c, g in parts]
                means = {k: float(np.mean([f[k] for f in found])) for k in found[0]}
                rows.append({"nodes": f"{side}x{side}", "network": network, **means})
            table(name, rows)


if __name__ == "__main__":
    main()
