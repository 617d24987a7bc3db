"""Defects of several shapes and places: what each network's local models mend and spoil.

python benchmarks/map_defects.py [--seeds N] [--fresh FIRST LAST]
"""

import argparse
from functools import partial

import numpy as np
from ablation import Ground, train_on
from ablation_cases import bump, ripple, simulated

from calib.common.parallel import one_blas_thread

ROWS, TESTED, SIDE = 20_000, 20_000, 20
NETWORKS = ("vdsom:residual", "som", "grid", "random")
WIDE = partial(bump, width=np.radians(6.0))
LOW = partial(bump, height=1e-3, width=np.radians(3.0))
ELSEWHERE = partial(ripple, window=np.radians([100.0, 110.0]))
SMALL = partial(ripple, amplitude=np.radians(0.2))


def step(arm):
    """1 mm within a square of both joints, nothing outside: an edge that is not smooth."""
    low, high = np.radians([30.0, 40.0]), np.radians([50.0, 60.0])

    def inside(q):
        return ((q > low) & (q < high)).all(axis=1)

    return lambda q: arm.forward(q) + 1e-3 * inside(q)[:, None] * np.array([0.6, 0.8]), inside


def disc(arm):
    """A wave of 2 mm, 60 cycles a turn of the elbow, within 8 deg of a place."""

    def inside(q):
        return np.linalg.norm(q - np.radians([60.0, 110.0]), axis=1) < np.radians(8.0)

    def truth(q):
        height = np.where(inside(q), 2e-3 * np.sin(60.0 * q[:, 1]), 0.0)
        return arm.forward(q) + height[:, None] * np.array([1.0, 0.3])

    return truth, inside


SHORT = partial(ripple, amplitude=np.radians(0.3), window=np.radians([40.0, 50.0]))
END = partial(ripple, window=np.radians([118.0, 130.0]))
# those of the ablation with every seed; the others with one of their own
SHAPES = (
    ("ripple, 100 to 110 deg", ELSEWHERE, None, 3),
    ("ripple of 0.2 deg", SMALL, None, 4),
    ("ripple, noise of 1 mm", ripple, 1e-3, 5),
    ("bump, 6 deg wide", WIDE, None, 2),
    ("bump of 1 mm, 3 deg wide", LOW, None, 3),
    # other seeds, places and shapes
    ("ripple", ripple, None, 11),
    ("ripple", ripple, None, 12),
    ("bump", bump, None, 13),
    ("ripple, 118 to 130 deg", END, None, 14),
    ("ripple of 0.3 deg, 40 to 50 deg", SHORT, None, 15),
    ("step of 1 mm", step, None, 18),
    ("wave in a disc", disc, None, 20),
)


def row(label: str, defect, noise: float | None, seed: int) -> str:
    """A row of the table: mean errors [mm] of each network, in the defect and elsewhere."""
    case = simulated("defect", ROWS, TESTED, seed, defect, noise)
    inside, ground = case.defect, Ground.of(case, seed)
    found = []
    for network in NETWORKS:
        trained = train_on(case, ground, network, SIDE, seed)
        for name in ("local",) if found else ("body", "local"):
            said = trained.predictors[name].value(ground.scale.to_unit(case.q))
            error = 1e3 * np.linalg.norm(said - case.x, axis=1)
            found.append((error[inside].mean(), error[~inside].mean()))
    cells = []
    for k, digits in ((0, 3), (1, 4)):
        body, own, *others = (pair[k] for pair in found)
        cells += [f"{e:.{digits}f}" for e in (body, own, *others)]
        cells.append(f"{own / min(body, *others):.2f}")
    return f"| {label}, seed {seed} | " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--fresh", type=int, nargs=2, help="seeds, of ripples and bumps alone")
    options = parser.parse_args()
    first, last = options.fresh or (0, options.seeds - 1)
    own = [
        (name, defect, None, seed)
        for name, defect in (("ripple", ripple), ("bump", bump))
        for seed in range(first, last + 1)
    ]
    with one_blas_thread():
        for each in own if options.fresh else (*own, *SHAPES):
            print(row(*each), flush=True)


if __name__ == "__main__":
    main()
