"""Arms that bend under gravity, with and without masses in their URDF: one row a case.

    python benchmarks/gravity.py [--seeds 3] [--data FOLDER]

A simulated `six_axis` sags by 3 mm; 300 rows at .1 mm are learned, of its whole range or of half of
it, and a payload may hang at the tip.  With FOLDER, series A and C of a real UR10
(docs/accuracy.md names their source), 300 rows, from its URDF as it is and without <inertial>.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tables import table, typed
from threadpoolctl import threadpool_limits

import calib
from calib.arm.gravity import GRAVITY, Loads
from calib.arm.loading import arm_from_urdf

Row = dict[str, Any]
MM = 1e3
SAG, NOISE, ROWS = 3e-3, 1e-4, 300  # [m], [m] along an axis, and rows that are learned
CASES = {"sags": {}, "half of its range": {"half": True}, "payload": {"payload": 4.0}}
TEXT = (Path(__file__).parents[1] / "robots/six_axis.urdf").read_text(encoding="utf-8")


def without_masses(text: str) -> str:
    """A URDF's text as most makers write it."""
    return re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL)


def world(seed: int, half: bool = False, payload: float = 0.0) -> tuple[np.ndarray, ...]:
    """Joints and readings that are learned, others and where the tip is there."""
    rng = np.random.default_rng(seed)
    arm = arm_from_urdf(TEXT)
    masses = arm.chain.masses + payload * (np.arange(6) == 5)
    loads = Loads.of_masses(replace(arm.chain, masses=masses))
    q = rng.uniform(arm.lower, arm.upper, (4000, 6))
    compliance = rng.uniform(0.5, 1.5, 6) * (1, 1, 1, 4, 4, 4)
    bends = 1e-6 * compliance * np.einsum("exn,x->ne", loads.levers(q), GRAVITY)
    offset = rng.normal(0.0, 3e-3, 6)
    moved = np.linalg.norm(arm.forward(q + bends) - arm.forward(q), axis=1).max()
    x = arm.forward(q + offset + SAG / moved * bends)
    low = q[:, 1] < (arm.lower[1] + arm.upper[1]) / 2 if half else np.arange(len(q)) < ROWS
    learned, others = np.flatnonzero(low)[:ROWS], np.flatnonzero(~low)[-800:]
    return q[learned], x[learned] + rng.normal(0.0, NOISE, (ROWS, 3)), q[others], x[others]


def judged(model: calib.Model, q: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """Mean distance [mm], and how many are within the bound [%]."""
    miss = np.linalg.norm(model.forward(q) - x, axis=1)
    return MM * float(miss.mean()), 100 * float((miss <= model.model_error(q)).mean())


def simulated(seeds: int) -> Iterator[Row]:
    """Errors of an arm that sags."""
    for case, options in CASES.items():
        for masses, text in (("with", TEXT), ("without", without_masses(TEXT))):
            arm = arm_from_urdf(text)
            named = arm.joint_names, arm.lower, arm.upper, arm.revolute
            found = []
            for seed in range(seeds):
                q, z, others, truth = world(seed, **options)
                model = calib.train(calib.Samples(q, z, *named, arm=arm, unit="m"))
                found.append(judged(model, others, truth))
            error, covered = np.mean(found, axis=0)
            yield {"case": case, "masses": masses, "error [mm]": error, "covered [%]": covered}


def measured(folder: Path, seeds: int) -> Iterator[Row]:
    """Errors of a real UR10 on a contiguous tenth that is held out."""
    from spatial import UR10, split

    text = UR10.read_text(encoding="utf-8")
    for name in "ac":
        for masses, urdf in (("with", text), ("without", without_masses(text))):
            arm = arm_from_urdf(urdf, tip="tool0")
            log = replace(calib.read_log(folder / f"full_{name}.csv", arm), orientation=None)
            gaps = []
            for learn, held in split(len(log), ROWS, seeds):
                model, rest = calib.train(log.take(learn)), log.take(held)
                miss = np.linalg.norm(model.forward(rest.q) - rest.x, axis=1)
                gaps.append([miss, miss <= model.expected_error(rest.q)])
            miss, within = np.concatenate(gaps, axis=1)
            row = {"error [mm]": MM * float(np.nanmean(miss)), "covered [%]": 100 * within.mean()}
            yield {"case": f"series {name.upper()}", "masses": masses, **row}


def main() -> None:
    """Print the table."""
    args = typed(__doc__, seeds=3, data=Path)
    with threadpool_limits(1):
        rows = list(simulated(args.seeds))
        if args.data is not None:
            rows += measured(args.data, args.seeds)
    table("Arms that bend", rows)


if __name__ == "__main__":
    main()
