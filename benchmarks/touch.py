"""Real arms calibrated by sockets that their tip touched: places left out in turn.

    python benchmarks/touch.py --data FOLDER

FOLDER holds panda_1.csv, kuka_14.csv, dinova_1.csv and the URDFs panda, iiwa14, gen3lite of MUKCa
(Franzese et al., MIT licence; docs/howto/touch.md names the source).  The fixture stood at several
places; each is left out in turn, and the tips' scatter about their own mean in its two sockets is
what is told.  Beside it stands the drawing with its tool alone fitted.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

import calib
from calib.body.fit import maximise
from calib.body.spatial import structure_of
from calib.body.touch import Touch, fit_touches
from calib.samples.samples import Samples

ARMS = {"panda_1": "panda", "kuka_14": "iiwa14", "dinova_1": "gen3lite"}
MM = 1e3


def tool_alone(arm: calib.PlanarArm, log: Samples, number: np.ndarray) -> np.ndarray:
    """Tip positions of the drawing, of which the tool alone was fitted to the touches."""
    base = structure_of(arm, "base")
    touch = Touch(base.measurement, int(number.max()) + 1)
    seen = base.with_view("touch", reading=touch)
    rows = np.column_stack([log.q, number])
    prior = seen.prior(("tool", "point"))
    start = touch.start(seen, rows)
    fit = maximise(
        seen, rows, np.zeros((len(rows), 3)), start, prior, nu=6.0, floor=np.full(3, 1e-4), steps=20
    )
    out = base.neutral()
    out[base.groups["tool"]] = fit.beta[seen.groups["tool"]]
    return out


def scatter(x: np.ndarray, number: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Distances of tips from the mean of their socket, and these means."""
    off, means = np.empty(len(x)), []
    for k in np.unique(number):
        means.append(x[number == k].mean(axis=0))
        off[number == k] = np.linalg.norm(x[number == k] - means[-1], axis=1)
    return off, means


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    folder = parser.parse_args().data
    print("| arm | rows, places | tool fitted [mm] | calib [mm] | distance off [mm] | processor |")
    print("|---|---|---|---|---|---|")
    for name, drawing in ARMS.items():
        path = folder / f"{name}.csv"
        header = path.read_text().split("\n", 1)[0].split(",")
        arm = calib.load_arm(folder / f"{drawing}.urdf", columns=header, tip="ball_link")
        log = calib.read_log(path, arm)
        log = replace(log, touch=log.touch.stated(["0,1=50mm+-0.2mm"]))
        setups = sorted({setup for setup, _ in log.touch.sockets})
        before, after, apart, seconds = [], [], [], 0.0
        for out in setups:
            here = np.array([log.touch.sockets[k][0] == out for k in log.touch.number])
            own, number = np.unique(log.touch.number[~here], return_inverse=True)
            known = [
                replace(each, points=tuple(int(np.searchsorted(own, k)) for k in each.points))
                for each in log.touch.known
                if set(each.points) <= set(own.tolist())
            ]
            base = structure_of(arm, "base")
            began = process_time()
            fit = fit_touches(
                base, log.q[~here], number, known, lower=log.lower, upper=log.upper
            ).fit.body
            seconds += process_time() - began
            beta = tool_alone(arm, log.take(~here), number)
            there = log.touch.number[here]
            before.append(scatter(base.predict(log.q[here], beta), there)[0].mean())
            off, means = scatter(fit.predict(log.q[here]), there)
            after.append(off.mean())
            apart.append(abs(np.linalg.norm(means[0] - means[1]) - 0.05))
        print(
            f"| {name} | {len(log)}, {len(setups)} | {MM * np.mean(before):.2f} | "
            f"{MM * np.mean(after):.2f} | {MM * np.mean(apart):.2f} | "
            f"{seconds / len(setups):.1f} s |"
        )


if __name__ == "__main__":
    main()
