"""Ablation: what the maps are for, and where they do not help.

python benchmarks/ablation.py [--data FOLDER] [--quick] [--seed K] [--sides 20,40]

Everything that can be left out is left out in turn: the body, the local models (the body
alone), the training of the maps, their varying density.  ``docs/maps.md`` reads the table.
"""

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ablation_cases import Array, Case, measured, simulated
from tables import table, typed
from untrained import UNTRAINED, untrained_pair

from calib.common.choices import MAP_READOUTS
from calib.common.parallel import one_blas_thread
from calib.common.scale import Scale
from calib.maps.association import Association
from calib.maps.local_models import NO_MODELS
from calib.maps.model_selection import select
from calib.maps.predictor import Predictor
from calib.training.maps import associate, wrong_around
from calib.training.options import TrainingOptions
from calib.training.smooth import SmoothPart, find_smooth_part

NETWORKS = ("vdsom:residual", "vdsom", "vdsom:rho", "som", "gng", *UNTRAINED)
CASES = ("exact", "bump", "ripple")


@dataclass(frozen=True, eq=False)
class Ground:
    """What all networks of a case share: the unit box, the body, and where it is wrong."""

    scale: Scale
    part: SmoothPart
    wrong: Array

    @staticmethod
    def of(case: Case, seed: int) -> "Ground":
        """Fit the body of a case."""
        samples = case.samples
        scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
        part = find_smooth_part(samples, TrainingOptions(seed=seed))
        return Ground(scale, part, wrong_around(part, samples, scale.to_unit(samples.q)))


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


def train_on(case: Case, ground: Ground, network: str, side: int, seed: int) -> Trained:
    """Train one network of side x side nodes on a case.

    The maps of a log learn from its rows alone here, without imagined samples, so that
    the networks differ by what they make of the same rows.
    """
    samples, scale, part, wrong = case.samples, ground.scale, ground.part, ground.wrong
    u = scale.to_unit(samples.q)
    started = time.perf_counter()
    if network in UNTRAINED:
        pair = untrained_pair(network, scale, u, samples.x, side, seed)
    else:
        options = TrainingOptions(side, map=network, seed=seed)
        pair = associate(scale, u, samples.x, options, wrong)
    alone = pair
    seconds, motor = time.perf_counter() - started, pair.motor
    held, seen = u[part.rows], samples.x[part.rows]
    predictor, _ = select(motor, held, seen, part.smooth, part.fit.held_out)
    if wrong is not None and network == "vdsom:residual":  # without a body nothing tells that
        alone = associate(scale, u, samples.x, TrainingOptions(side, map=network, seed=seed))
    predictors = {
        "local": predictor,
        "body": Predictor(motor, part.smooth, NO_MODELS),
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
                found = [measure(c, train_on(c, g, network, side, told.seed)) for c, g in parts]
                means = {k: float(np.mean([f[k] for f in found])) for k in found[0]}
                rows.append({"nodes": f"{side}x{side}", "network": network, **means})
            table(name, rows)


if __name__ == "__main__":
    main()
