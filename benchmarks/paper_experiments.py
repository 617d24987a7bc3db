"""Experiments beside the paper's tables: networks, resampling.

python benchmarks/paper_experiments.py [networks resampling] [--quick]
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from tables import table

from calib.maps.density import GAINS
from calib.paper.setting import Setting
from calib.paper.tables import FACTORS, UNITS
from calib.paper.trial import (
    SAME_SCHEDULE,
    NetworkTrial,
    Row,
    Schedule,
    row_of_seeds,
)
from calib.samples.samples import Samples

_ROWS = 20_000  # of each seed: enough to tell these apart
_BORDER = 0.05  # share of a joint's range that counts as its border


def networks(setting: Setting) -> None:
    """Every network and reading of the varying density, at its own default schedule."""
    n = min(setting.samples, _ROWS)
    few = replace(setting, seeds=setting.seeds[: 1 if setting.quick else 2])
    names = ["som", *(f"vdsom:{name}" for name in GAINS if name != "printed")]
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
        rows[f"SOM, border drawn {times} times as often"] = row_of_seeds(found)
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
    runs = {run.__name__: run for run in (networks, resampling)}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", choices=[*runs, []], default=[])
    parser.add_argument("--quick", action="store_true")
    told = parser.parse_args()
    for name in told.what or runs:
        runs[name](Setting.of(quick=told.quick))


if __name__ == "__main__":
    main()
