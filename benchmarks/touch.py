"""Real arms calibrated by sockets that their tip touched: places left out in turn.

    python benchmarks/touch.py --data FOLDER [--postures]

FOLDER holds panda_1.csv, kuka_14.csv, dinova_1.csv and the URDFs panda, iiwa14, gen3lite of MUKCa
(Franzese et al., MIT licence; docs/howto/touch.md names the source).  The fixture stood at several
places; each is left out in turn, and the tips' scatter about their own mean in its two sockets is
what is told, of all of its rows.  Beside it stand the drawing with its tool alone fitted, and
MUKCa's objective as its paper has it (the variance in each socket and the bias of the sockets'
distance, squared, over six numbers of each joint's origin and the tool, without a prior).
`--postures` instead learns from some of the postures in each socket.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from scipy.optimize import least_squares

import calib
from calib.body.fit import Fit
from calib.body.rows import with_measurements
from calib.body.spatial import structure_of
from calib.body.touch import rows_of_touches
from calib.samples.samples import Samples
from calib.training.options import TrainingOptions
from calib.training.socket_fit import fit_sockets

ARMS = {"panda_1": "panda", "kuka_14": "iiwa14", "dinova_1": "gen3lite"}
MM = 1e3
APART = 0.05  # the sockets' distance [m]
POSTURES = (5, 8, 12, 20, 30)


def tool_alone(arm: calib.PlanarArm, log: Samples) -> np.ndarray:
    """Parameters of the drawing, of which the tool alone was fitted to the touches."""
    base, number = structure_of(arm, "base"), log.touch.numbers_and_facts()[0]
    rows = [replace(rows_of_touches(log.q, number, (), log.x)[0], floor=1e-4)]
    seen = with_measurements(base, rows)
    fit = Fit(seen, rows, seen.neutral(), seen.prior(("tool", "point")), nu=6.0).maximise(steps=20)
    out = base.neutral()
    out[base.groups["tool"]] = fit.beta[seen.groups["tool"]]
    return out


def mukca(arm: calib.PlanarArm, log: Samples) -> np.ndarray:
    """Parameters that minimise the variance in each socket and the bias of their distance."""
    base, (number, known, own) = structure_of(arm, "base"), log.touch.numbers_and_facts()
    free = np.concatenate([base.groups["tool"], base.shifts.ravel(), base.turns.ravel()])

    def residual(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        beta = base.neutral()
        beta[free] = values
        x, slope = base.linearise(log.q, beta, free)
        means = np.array([x[number == k].mean(axis=0) for k in range(len(own))])
        slopes = np.array([slope[number == k].mean(axis=0) for k in range(len(own))])
        counts = np.sqrt(np.bincount(number))[number]
        out = [((x - means[number]) / counts[:, None]).ravel()]
        by = [((slope - slopes[number]) / counts[:, None, None]).reshape(-1, len(free))]
        for each in known:
            i, j = each.points
            gap = means[i] - means[j]
            length = np.linalg.norm(gap)
            out.append([length - each.value])
            by.append((gap / length @ (slopes[i] - slopes[j]))[None])
        return np.concatenate(out), np.concatenate(by)

    found = least_squares(
        lambda v: residual(v)[0], np.zeros(len(free)), lambda v: residual(v)[1], x_scale="jac",
        max_nfev=100,
    )  # fmt: skip
    out = base.neutral()
    out[free] = found.x
    return out


def scatter(x: np.ndarray, number: np.ndarray) -> tuple[np.ndarray, float]:
    """Distances of tips from the mean of their socket, and how far the means' distance is off."""
    off, means = np.empty(len(x)), []
    for k in np.unique(number):
        means.append(x[number == k].mean(axis=0))
        off[number == k] = np.linalg.norm(x[number == k] - means[-1], axis=1)
    return off, abs(float(np.linalg.norm(means[0] - means[1])) - APART)


def load(folder: Path, name: str) -> tuple[calib.PlanarArm, Samples, list[np.ndarray]]:
    """An arm, its touches, and the rows of each place of the fixture."""
    path = folder / f"{name}.csv"
    header = path.read_text().split("\n", 1)[0].split(",")
    arm = calib.load_arm(folder / f"{ARMS[name]}.urdf", columns=header, tip="ball_link")
    log = calib.read_log(path, arm)
    log = replace(log, touch=log.touch.with_stated_facts(["0,1=50mm+-0.2mm"]))
    setups = np.array([log.touch.sockets[k][0] for k in log.touch.number])
    return arm, log, [setups == each for each in sorted(set(setups))]


def learned(log: Samples) -> object:
    """The belief that touches give."""
    return fit_sockets(log, log.touch, TrainingOptions()).fit.body


def places(folder: Path) -> None:
    """Print the table of places left out."""
    print("| arm | rows, places | tool fitted | MUKCa's objective | calib | distance off | bound |")
    print("|---|---|---|---|---|---|---|")
    for name in ARMS:
        arm, log, setups = load(folder, name)
        base, rows, covered, seconds = structure_of(arm, "base"), [], [], 0.0
        for here in setups:
            seen, q, number = log.take(~here), log.q[here], log.touch.number[here]
            began = process_time()
            body = learned(seen)
            seconds += process_time() - began
            off, apart = scatter(body.predict(q), number)
            others = [
                scatter(base.predict(q, fitted(arm, seen)), number)
                for fitted in (tool_alone, mukca)
            ]
            means = [other[0].mean() for other in others]
            rows.append([*means, off.mean(), apart, others[1][1]])
            covered.append(off < body.bound(q))
        told = MM * np.mean(rows, axis=0)
        print(
            f"| {name} | {len(log)}, {len(setups)} | {told[0]:.2f} mm | {told[1]:.2f} mm, distance "
            f"{told[4]:.2f} | {told[2]:.2f} mm | {told[3]:.2f} mm | covers "
            f"{100 * np.concatenate(covered).mean():.0f} %; {seconds / len(setups):.1f} s |",
            flush=True,
        )


def postures(folder: Path) -> None:
    """Print how accuracy grows with the postures in each socket."""
    print(f"| postures in each socket | {' | '.join(map(str, POSTURES))} |")
    print("|" + "---|" * (len(POSTURES) + 1))
    for name in ARMS:
        _, log, setups = load(folder, name)
        cells = []
        for count in POSTURES:
            off, order = [], np.random.default_rng(0).permutation(len(log))
            rank = np.empty(len(log), int)
            for k in range(len(log.touch.sockets)):
                own = order[log.touch.number[order] == k]
                rank[own] = np.arange(len(own))
            for here in setups:
                body = learned(log.take(~here & (rank < count)))
                off.append(scatter(body.predict(log.q[here]), log.touch.number[here])[0].mean())
            cells.append(f"{MM * np.mean(off):.2f}")
        print(f"| {name} [mm] | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--postures", action="store_true")
    asked = parser.parse_args()
    (postures if asked.postures else places)(asked.data)


if __name__ == "__main__":
    main()
