"""Experiments beside the paper's tables: networks, resampling, perturbed commands, directions.

python benchmarks/paper_experiments.py [networks resampling perturbation directions] [--quick]
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from tables import table

from calib.maps.association import Association
from calib.maps.density import READINGS
from calib.maps.links import WIRINGS
from calib.paper.setting import Setting
from calib.paper.tables import COLUMNS, FACTORS, UNITS
from calib.paper.trial import (
    SAME_SCHEDULE,
    NetworkTrial,
    Row,
    Schedule,
    activity_errors,
    association,
    joined,
)
from calib.samples.samples import Samples

_ROWS = 20_000  # of each seed: enough to tell these apart
_BORDER = 0.05  # share of a joint's range that counts as its border
_TREMBLE = (0.0, 0.5, 1.0, 2.0, 5.0)  # deg


def networks(setting: Setting) -> None:
    """Every network and reading of the varying density, at its own default schedule."""
    n = min(setting.samples, _ROWS)
    few = replace(setting, seeds=setting.seeds[: 1 if setting.quick else 2])
    names = ["som", *(f"vdsom:{name}" for name in READINGS if name != "printed")]
    names += ["dsom", "gng", "gng:error", "gng:border"]
    rows: dict[str, Row] = {}
    for k, name in enumerate(names):
        setting.report(k / len(names), name)
        rows[name] = NetworkTrial(name, Schedule(), setting.side).row(few, n)
    for name in ("som", "vdsom"):
        online = Schedule(5, 0.5 if name == "som" else 1.5, rule="online")
        rows[f"{name}, online rule"] = NetworkTrial(name, online, setting.side).row(few, n)
        same = replace(SAME_SCHEDULE, links="oja")
        rows[f"{name}, {same}"] = NetworkTrial(name, same, setting.side).row(few, n)
    title = f"networks, {n:,} samples, {len(few.seeds)} seeds, readout activity"
    show(title, rows)


def resampling(setting: Setting) -> None:
    """Test the paper's first hypothesis: that data are too few at the border.

    The rows near a joint limit are drawn more often, as many rows in all; maps and links
    learn from them.  A gain per sample differs: it follows the lattice, not the data,
    grows while the map settles, and leaves the links to the data as they are.
    """
    n = min(setting.samples, _ROWS)
    seeds = setting.seeds[:3]
    rows = {}
    for times in (1, 3, 10):
        found = []
        for seed in seeds:
            samples = setting.babble(seed, n)
            found.append(
                NetworkTrial("som", SAME_SCHEDULE, setting.side).errors(
                    crowded(samples, times, seed), seed
                )
            )
        rows[f"SOM, border drawn {times} times as often"] = joined(found)
    few = replace(setting, seeds=seeds)
    rows["VDSOM, gain per sample"] = NetworkTrial("vdsom", SAME_SCHEDULE, setting.side).row(few, n)
    title = f"data at the border against a gain, {SAME_SCHEDULE}, {n:,} samples, {len(seeds)} seeds"
    show(title, rows)


def crowded(samples: Samples, times: float, seed: int) -> Samples:
    """As many rows, those near a joint limit drawn `times` times as often as the others."""
    if times == 1:
        return samples
    u = (samples.q - samples.lower) / (samples.upper - samples.lower)
    near = np.minimum(u, 1.0 - u).min(axis=1) < _BORDER
    weight = np.where(near, float(times), 1.0)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(times),)))
    rows = np.sort(rng.choice(len(u), len(u), p=weight / weight.sum()))
    return replace(samples, q=samples.q[rows], x=samples.x[rows])


def perturbation(setting: Setting) -> None:
    """Motor commands that are perturbed while learning, where Schillaci et al. degraded.

    The joints go where they were sent plus a random error; tested without it.
    """
    n = min(setting.samples, _ROWS)
    seeds = setting.seeds[:2]
    rows: dict[str, Row] = {}
    for degrees in _TREMBLE[:: 4 if setting.quick else 1]:
        setting.report(degrees / max(_TREMBLE), f"commands off by {degrees:g} deg")
        tremble = np.radians(degrees)
        changes = [f"{joint}.noise={tremble:.9g}" for joint in COLUMNS[2:]]
        found = []
        for seed in seeds:
            samples = setting.babble(seed, n, changes=changes if degrees else ())
            found.append(NetworkTrial("vdsom", Schedule(), setting.side).errors(samples, seed))
        rows[f"{degrees:g} deg"] = joined(found)
    title = f"commands perturbed while learning (standard deviation), {n:,} samples, "
    title += f"{len(seeds)} seeds, tested on the arm at rest"
    show(title, rows, ("winner", "activity", "linear"))


def directions(setting: Setting) -> None:
    """One set of links for both directions, against one set learned for each.

    Buessler et al. needed a module for each direction.  Links that are normalised by the
    side which they lead to are Oja's rule (eq. 5) of that direction.
    """
    seed = setting.seeds[0]
    samples = setting.babble(seed, min(setting.samples, _ROWS))
    q, x = setting.validation(samples, seed)
    data: dict[str, Any] = {}
    one = association(samples, "vdsom", Schedule(), setting.side, seed)
    ahead, back = _one_sided(one, samples)
    found = {
        "one reciprocal set": (one, one),
        "one set, eq. 5 from motor to sensory": (ahead, ahead),
        "a set for each direction": (ahead, back),
    }
    columns = COLUMNS
    spans = np.concatenate([one.sensory.scale.span, one.motor.scale.span])
    for name, (forward, inverse) in found.items():
        first, second = (activity_errors(pair, q, x) for pair in (forward, inverse))
        errors = np.concatenate([first[:, :2], second[:, 2:]], axis=1) * spans
        sizes = zip(columns, errors.T, strict=True)
        data[name] = {c: {"mean": float(e.mean()), "max": float(e.max())} for c, e in sizes}
    rows = [{"links": name, **cells(each)} for name, each in data.items()]
    table("both directions from one set of links, readout activity, one seed", rows)


def _one_sided(pair: Association, samples: Samples) -> tuple[Association, Association]:
    """The same maps with links of eq. 5 for each direction."""
    wiring = WIRINGS["local"]
    motor, sensory = pair.motor, pair.sensory
    a = wiring.activity(motor, motor.scale.to_unit(samples.q))
    b = wiring.activity(sensory, sensory.scale.to_unit(samples.x))
    mine, theirs = (np.asarray(part.multiply(part).sum(axis=0)).ravel() for part in (a, b))
    back = wiring.link((b.T @ a).tocsr(), theirs, mine).transposed()
    return (
        Association(motor, sensory, wiring.link((a.T @ b).tocsr(), mine, theirs), wiring),
        Association(motor, sensory, back, wiring),
    )


def cells(columns: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Mean and largest error of each column, in the units of the paper's tables."""
    found = {}
    for name, error in columns.items():
        if name.endswith("distance"):
            continue
        unit = UNITS[name]
        found |= {f"{name} {k} [{unit}]": error[k] * FACTORS[unit] for k in ("mean", "max")}
    return found


def show(title: str, rows: dict[str, Row], readouts: tuple[str, ...] = ("activity",)) -> None:
    """Print a line for each row and readout."""
    named = ((name, row, readout) for name, row in rows.items() for readout in readouts)
    table(title, [{"": name, "readout": r, **cells(row[r])} for name, row, r in named])


def main() -> None:
    """Print the tables."""
    runs = {run.__name__: run for run in (networks, resampling, perturbation, directions)}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", choices=[*runs, []], default=[])
    parser.add_argument("--quick", action="store_true")
    told = parser.parse_args()
    for name in told.what or runs:
        runs[name](Setting.of(quick=told.quick))


if __name__ == "__main__":
    main()
