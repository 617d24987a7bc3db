"""Ablation: what the maps are for, and where they do not help.

python benchmarks/ablation.py [--data DIR] [--quick] [--seed K] [--sides 20,40] -o OUT

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
from ablation_cases import Case, measured, simulated
from numpy.typing import NDArray

from calib.arm.arm import PlanarArm
from calib.common.arrays import Array
from calib.common.choices import MAP_READOUTS
from calib.common.parallel import one_blas_thread
from calib.common.scale import Scale
from calib.inverse.solver import Solver
from calib.maps.association import Association
from calib.maps.local_models import NO_MODELS
from calib.maps.model_selection import select
from calib.maps.node_bounds import blend_nodes, learn_bounds
from calib.maps.predictor import Predictor
from calib.paper.setting import Setting
from calib.paper.tables import Result, Table
from calib.training.learn import associate
from calib.training.options import TrainingOptions
from calib.training.smooth import SmoothPart, find_smooth_part, wrong_around

_NETWORKS = ("vdsom:residual", "vdsom", "vdsom:rho", "som", "gng", "grid", "random", "rows")
"""Networks that are compared; the last three are not trained."""

_CASES = ("exact", "noise", "bump", "ripple", "uneven")
"""Simulated cases, see :func:`ablation_cases.simulated`."""

_SERIES = {"a": "UR10 A", "c": "UR10 C"}
"""Real logs of a data folder, by the letter in ``series_<letter>.csv``."""

_JOINTS = ("shoulder_lift_joint", "elbow_joint")
_SIDES = (10, 20, 40, 70)
_ROWS = 20_000
_TESTED = 5_000
_TARGETS = 200  # of which all branches are asked, and the one nearest to the truth
_BLOCKS = 5  # contiguous blocks of a real log, two of which are held out in turn
_FOUND = np.radians(1.0)  # a branch that is further off in a joint was missed


@dataclass(frozen=True, eq=False)
class Trained:
    """One network on one case."""

    # maps and links, learned with and without knowing where the body is wrong
    association: Association
    alone: Association
    # ``local`` (the body and local models), ``body`` alone, and ``linear`` (no body)
    predictors: dict[str, Predictor]
    # dict of str to (nodes,) array [unit], 95 % bound of ``local`` and ``linear`` at the nodes,
    # from errors on held-out rows
    bounds: dict[str, Array]
    seconds: float  # training of both maps and their links [s]


def ablation(setting: Setting, data: Path | None = None, sides: tuple[int, ...] = _SIDES) -> Result:
    """Run the ablation.

    setting : its first seed is used; ``quick`` makes everything small
    data : a folder with ``series_a.csv`` and ``series_c.csv`` of a UR10
    """
    sides = (6, 8) if setting.quick else sides
    rows = 600 if setting.quick else _ROWS
    seed, cases = setting.seeds[0], list(_cases(setting, rows, data))
    records: list[dict[str, Any]] = []
    total = len(cases) * len(sides) * len(_NETWORKS)
    with one_blas_thread():
        grounds = [Ground.of(case, seed) for case in cases]
        for side, (case, ground), network in itertools.product(
            sides, zip(cases, grounds, strict=True), _NETWORKS
        ):
            setting.report(len(records) / total, f"{case.name}, {network} {side}x{side}")
            cell = {"case": case.name, "nodes": f"{side}x{side}", "network": network}
            found = measure(case, train_on(case, ground, network, side, seed))
            records.append({**cell, **found})
    merged = _merged(records)
    names = dict.fromkeys(r["case"] for r in merged)
    tables = [_table(name, [r for r in merged if r["case"] == name]) for name in names]
    rows_of_all = [tuple(record.values()) for record in merged]
    tables.append(Table("ablation", "ablation, all figures", tuple(merged[0]), rows_of_all))
    return Result({"rows": merged, "quick": setting.quick}, tuple(tables))


def _cases(setting: Setting, rows: int, data: Path | None) -> Iterator[Case]:
    tested = 500 if setting.quick else _TESTED
    for name in _CASES:
        yield simulated(name, rows, tested, setting.seeds[0])
    if data is None:
        return
    for letter, name in _SERIES.items():
        for block in (1, 3):
            case = measured(data / f"series_{letter}.csv", name, _JOINTS, block, _BLOCKS)
            if setting.quick:
                every = slice(None, None, max(1, len(case.samples) // rows))
                case = Case(name, case.samples.take(every), case.q, case.x, case.defect, case.arm)
            yield case


@dataclass(frozen=True, eq=False)
class Ground:
    """What all networks of a case share: the unit box, the body, and where it is wrong."""

    scale: Scale
    part: SmoothPart
    wrong: Array | None

    @staticmethod
    def of(case: Case, seed: int) -> "Ground":
        """Fit the body of a case."""
        samples = case.samples
        scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
        part = find_smooth_part(samples, seed=seed)
        wrong = wrong_around(part, samples, scale.to_unit(samples.q))
        return Ground(scale, part, wrong)


def train_on(case: Case, ground: Ground, network: str, side: int, seed: int) -> Trained:
    """Train one network of side x side nodes on a case.

    The maps of a log learn from its rows alone here, without imagined samples, so that
    the networks differ by what they make of the same rows.
    """
    samples, scale, part, wrong = case.samples, ground.scale, ground.part, ground.wrong
    options = TrainingOptions(side, map=network, seed=seed)
    u = scale.to_unit(samples.q)
    started = time.perf_counter()
    pair = associate(scale, u, samples.x, options, wrong)
    seconds, motor = time.perf_counter() - started, pair.motor
    smooth, rows = part.smooth, part.rows
    predictor, left = select(motor, u[rows], samples.x[rows], smooth, part.fit.held_out)
    alone = pair
    if (
        wrong is not None and network == "vdsom:residual"
    ):  # without a body nothing tells where it is wrong
        alone = associate(scale, u, samples.x, options)
    predictors = {
        "local": predictor,
        "body": Predictor(motor, smooth, NO_MODELS),
        "linear": Predictor(alone.motor, alone.linear, NO_MODELS),
    }
    held = u[rows]
    # maps are judged by rows that they have seen: each node averages many
    own = np.linalg.norm(alone.linear.value(held) - samples.x[rows], axis=1)
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
    u = scale.to_unit(q)
    figures: dict[str, float | None] = {}
    for name, predictor in trained.predictors.items():
        error = np.linalg.norm(predictor.value(u) - x, axis=1)
        figures |= _forward(name, error, inside)
        if name in trained.bounds:
            bound = blend_nodes(predictor.motor, trained.bounds[name], u)
            figures[f"{name} covered"] = 100.0 * float(np.mean(error <= bound))
    near = np.clip(u, 0.0, 1.0)
    v = pair.sensory.scale.to_unit(x)
    for readout in MAP_READOUTS:
        if readout != "linear":  # that of the maps that stand alone is above
            predicted = pair.sensory.scale.from_unit(pair.forward(u, readout))
            figures |= _forward(readout, np.linalg.norm(predicted - x, axis=1), inside)
        maps = trained.alone if readout == "linear" else pair
        answer = np.clip(maps.inverse(v, near, readout), 0.0, 1.0)
        figures[f"{readout} inverse"] = _degrees(scale, answer, u)
    solver = Solver(pair, trained.predictors["local"])
    some = slice(None, None, max(1, len(x) // _TARGETS))
    answer = solver.solve(x[some], near[some])[0]
    figures["local inverse"] = _degrees(scale, answer, u[some])
    figures["missed"] = None if case.arm is None else _missed(case, case.arm, solver)
    figures["seconds"] = trained.seconds
    return figures


def _forward(name: str, error: Array, inside: NDArray[np.bool_]) -> dict[str, float | None]:
    return {
        f"{name} defect": float(error[inside].mean() * 1e3) if inside.any() else None,
        f"{name} elsewhere": float(error[~inside].mean() * 1e3),
        f"{name} max": float(error.max() * 1e3),
    }


def _degrees(scale: Scale, answer: Array, u: Array) -> float:
    gap = np.abs(scale.difference(answer, u)) * scale.span
    return float(np.degrees(gap).mean())


def _missed(case: Case, arm: PlanarArm, solver: Solver) -> float:
    """Share of the arm's true branches that no answer is near to [%]."""
    q, x = case.q[:_TARGETS], case.x[:_TARGETS]
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
            missed += not (gap < _FOUND).any()
            count += 1
    return 100.0 * missed / count


def _merged(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Blocks of one log as one row: the means of their figures."""
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for record in records:
        groups.setdefault(tuple(record[k] for k in ("case", "nodes", "network")), []).append(record)
    return [
        {
            k: float(np.mean([r[k] for r in group])) if isinstance(v, float) else v
            for k, v in group[0].items()
        }
        for group in groups.values()
    ]


def _table(name: str, records: list[dict[str, Any]]) -> Table:
    """The figures of one case that people read."""
    defect = records[0]["local defect"] is not None
    parts = ("defect", "elsewhere") if defect else ("elsewhere",)
    columns = [f"{r} {p}" for r in ("local", "body", "linear", "activity", "winner") for p in parts]
    columns += [f"{r} inverse" for r in ("local", "linear", "activity")]
    columns += ["missed", "local covered", "linear covered", "seconds"]
    kept = [c for c in columns if records[0][c] is not None]
    header = ["nodes", "network", *(c if defect else c.removesuffix(" elsewhere") for c in kept)]
    rows = [[r["nodes"], r["network"], *(r[c] for c in kept)] for r in records]
    title = (
        f"{name}: mean errors [mm], inverse [deg], missed branches and coverage [%], training [s]"
    )
    return Table(f"ablation_{name.lower().replace(' ', '_')}", title, header, rows)


def main() -> None:
    """Run it, and write CSV files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sides", default=",".join(map(str, _SIDES)))
    parser.add_argument("-o", "--output", type=Path, default=Path("reproduced"))
    told = parser.parse_args()
    sides = tuple(int(side) for side in told.sides.split(","))
    found = ablation(Setting.of(told.seed, quick=told.quick), told.data, sides)
    told.output.mkdir(parents=True, exist_ok=True)
    for table in found.tables:
        (told.output / f"{table.name}.csv").write_text(table.csv())
        print(told.output / f"{table.name}.csv")


if __name__ == "__main__":
    main()
