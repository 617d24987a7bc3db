"""Ablation: what the maps are for, and where they do not help.

python benchmarks/ablation.py [--data FOLDER] [--quick] [--seed K] [--sides 20,40]

Everything that can be left out is left out in turn: the body, the local models (the body
alone), the training of the maps, their varying density.  ``docs/maps.md`` reads the table.
"""

import argparse
import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ablation_cases import Array, Case, measured, simulated
from tables import table
from untrained import UNTRAINED, untrained_pair

from calib.common.choices import MAP_READOUTS
from calib.common.parallel import one_blas_thread
from calib.common.scale import Scale
from calib.inverse.links import search_by_links
from calib.inverse.search import Search
from calib.maps.association import Association
from calib.maps.local_models import NO_MODELS
from calib.maps.model_selection import select
from calib.maps.node_bounds import blend_nodes, learn_bounds
from calib.maps.predictor import Predictor
from calib.training.learn import TrainingOptions, associate
from calib.training.smooth import SmoothPart, find_smooth_part, wrong_around

NETWORKS = ("vdsom:residual", "vdsom", "vdsom:rho", "som", "gng", *UNTRAINED)
CASES = ("exact", "noise", "bump", "ripple", "uneven")
TARGETS = 200  # of which all branches are asked, and the one nearest to the truth
FOUND = np.radians(1.0)  # a branch that is further off in a joint was missed


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

    # maps and links, learned with and without knowing where the body is wrong
    association: Association
    alone: Association
    # ``local`` (the body and local models), ``body`` alone, and ``linear`` (no body)
    predictors: dict[str, Predictor]
    # (nodes,) [unit], 95 % bounds of ``local`` and ``linear``, from errors on held-out rows
    bounds: dict[str, Array]
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
    predictor, left = select(motor, held, seen, part.smooth, part.fit.held_out)
    if wrong is not None and network == "vdsom:residual":  # without a body nothing tells that
        alone = associate(scale, u, samples.x, TrainingOptions(side, map=network, seed=seed))
    predictors = {
        "local": predictor,
        "body": Predictor(motor, part.smooth, NO_MODELS),
        "linear": Predictor(alone.motor, alone.linear, NO_MODELS),
    }
    # maps are judged by rows that they have seen: each node averages many
    own = np.linalg.norm(alone.linear.value(held) - seen, axis=1)
    bounds = {
        "local": learn_bounds(motor, held, np.linalg.norm(left, axis=1)),
        "linear": learn_bounds(alone.motor, held, own),
    }
    return Trained(pair, alone, predictors, bounds, seconds)


def measure(case: Case, trained: Trained) -> dict[str, float | None]:
    """Errors, coverage of the bounds and missed branches of a trained network.

    Forward errors are mean distances [mm] in the defect, where there is one, and elsewhere;
    inverse ones of the branch nearest to the truth, mean over both joints [deg]; shares [%].
    """
    pair = trained.association
    scale, q, x, inside = pair.motor.scale, case.q, case.x, case.defect
    u, figures = scale.to_unit(q), dict[str, float | None]()

    def forward(name: str, said: Array) -> Array:
        error = np.linalg.norm(said - x, axis=1)
        if inside.any():
            figures[f"{name} defect"] = float(1e3 * error[inside].mean())
        figures[f"{name} elsewhere"] = float(1e3 * error[~inside].mean())
        return error

    def inverse(name: str, answer: Array, true: Array) -> None:
        gap = np.abs(scale.difference(answer, true)) * scale.span
        figures[f"{name} inverse"] = float(np.degrees(gap).mean())

    for name, predictor in trained.predictors.items():
        error = forward(name, predictor.value(u))
        if name in trained.bounds:
            bound = blend_nodes(predictor.motor, trained.bounds[name], u)
            figures[f"{name} covered"] = 100.0 * float(np.mean(error <= bound))
    near, v = np.clip(u, 0.0, 1.0), pair.sensory.scale.to_unit(x)
    for readout in MAP_READOUTS:
        if readout != "linear":  # that of the maps that stand alone is above
            forward(readout, pair.sensory.scale.from_unit(pair.forward(u, readout)))
        maps = trained.alone if readout == "linear" else pair
        inverse(readout, np.clip(maps.inverses(v, near)[readout], 0.0, 1.0), u)
    solver = search_by_links(pair, trained.predictors["local"])
    some = slice(None, None, max(1, len(x) // TARGETS))
    inverse("local", solver.solve(x[some], near[some])[0], u[some])
    if case.arm is not None:
        figures["missed"] = _missed(case, case.arm, solver)
    return figures | {"seconds": trained.seconds}


def _missed(case: Case, arm: Any, solver: Search) -> float:
    """Share of the arm's true branches that no answer is near to [%]."""
    q, x = case.q[:TARGETS], case.x[:TARGETS]
    first, second = arm.link_lengths.values()
    # the mirrored elbow leads to the same place
    turn = 2.0 * np.arctan2(second * np.sin(q[:, 1]), first + second * np.cos(q[:, 1]))
    other = np.stack([q[:, 0] + turn, -q[:, 1]], axis=1)
    exists = ((other >= arm.lower) & (other <= arm.upper)).all(axis=1)
    exists &= np.linalg.norm(arm.forward(other) - x, axis=1) < 1e-9
    target, u, _ = solver.solve_all(x)
    found = solver.scale.from_unit(u)
    missed, count = 0, 0
    for branch, rows in ((q, np.arange(len(q))), (other, np.flatnonzero(exists))):
        for row in rows:
            gap = np.abs(found[target == row] - branch[row]).max(axis=1, initial=0.0)
            missed += not (gap < FOUND).any()
            count += 1
    return 100.0 * missed / count


def main() -> None:
    """Print a table for each case: mean errors [mm], inverse [deg], shares [%], training [s]."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sides", type=lambda text: [int(n) for n in text.split(",")])
    told = parser.parse_args()
    sides = told.sides or ((6, 8) if told.quick else (10, 20, 40, 70))
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
