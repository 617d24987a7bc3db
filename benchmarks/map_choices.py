"""Measure which map `--body none` chooses for a log, and how both do where they are asked.

python benchmarks/map_choices.py [--data FOLDER]

FOLDER holds series_a.csv and series_c.csv of a UR10; two of ten blocks of each are held out. The
uneven logs dwell in a corner and are asked evenly.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from ablation_cases import Case, measured, simulated

from calib.common.parallel import one_blas_thread
from calib.common.scale import Scale
from calib.training.learn import associate, resolved
from calib.training.options import TrainingOptions

JOINTS = ("shoulder_lift_joint", "elbow_joint")
UNEVEN = tuple((n, seed) for n in (3000, 20_000) for seed in range(5))
NETWORKS = ("vdsom", "gas")


def cases(folder: Path | None) -> Iterator[tuple[str, list[Case]]]:
    """Logs with what they are asked: one of several blocks, or even points."""
    for name in "ac" if folder else "":
        path = folder / f"series_{name}.csv"
        held = [measured(path, name, JOINTS, block, 10) for block in (2, 7)]
        yield f"UR10 {name.upper()}", held
    for n, seed in UNEVEN:
        yield f"uneven, seed {seed}", [simulated("uneven", n, 4000, seed)]


def row(label: str, held: list[Case], side: int | None) -> str:
    """A row of the table: the choices, and mean errors [mm] of `linear` with either map."""
    found, chosen, sides = [], [], set()
    for case in held:
        log = case.samples
        options, _ = resolved(log, TrainingOptions(side, body="none"))
        sides.add("x".join(map(str, options.shapes[0])))
        chosen.append(options.map)
        scale = Scale.of_range(log.lower, log.upper, log.revolute)
        errors = []
        for network in NETWORKS:
            pair = associate(scale, scale.to_unit(log.q), log.x, replace(options, map=network))
            missed = pair.linear.value(scale.to_unit(case.q)) - case.x
            errors.append(1e3 * float(np.linalg.norm(missed, axis=1).mean()))
        found.append(errors)
    told = [label, f"{len(held[0].samples):,}", "/".join(sorted(sides))]
    told += ["/".join(dict.fromkeys(chosen)), *(f"{e:.2f}" for e in np.mean(found, axis=0))]
    return "| " + " | ".join(told) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    with one_blas_thread():
        for label, held in cases(parser.parse_args().data):
            for side in (20, None):
                print(row(label, held, side), flush=True)


if __name__ == "__main__":
    main()
