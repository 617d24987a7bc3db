"""Figures of docs/paper.md and docs/maps.md: readouts, small lattices, eq. 7 and 8, many joints.

python benchmarks/map_readouts.py linear|small|rho|rules|joints|time [--samples N] [--seeds N]
"""

import argparse
import time

import numpy as np

import calib
from calib.common.choices import MAP_READOUTS
from calib.common.parallel import one_blas_thread
from calib.common.scale import Scale
from calib.maps.association import Association
from calib.training.learn import associate
from calib.training.options import TrainingOptions

ROBOT = "two_link"
TESTED = 10_000


def trained(
    network: str, side: int, n: int, seed: int, sigma: float | None = None, **how: object
) -> tuple:
    """Maps and links, test joints and positions in their unit boxes, processor time [s]."""
    samples = calib.babble(calib.load_arm(ROBOT), n, seed=seed)
    scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
    epochs, radii = (None, None) if sigma is None else (20, (side / 2, sigma))
    chosen = {"map": network, "epochs": epochs, "sigma": radii, "seed": seed} | how
    options = TrainingOptions(side, **chosen)
    started = time.process_time()
    pair = associate(scale, scale.to_unit(samples.q), samples.x, options)
    seconds = time.process_time() - started
    q = samples.simulation.draw(TESTED, np.random.default_rng(1234 + seed))
    v = pair.sensory.scale.to_unit(samples.simulation.exact(q))
    return pair, scale.to_unit(q), v, seconds


def errors(pair: Association, u: np.ndarray, v: np.ndarray, readout: str) -> np.ndarray:
    """Absolute errors (n, 4): x, y [mm], shoulder, elbow [deg]."""
    forward = np.abs(pair.forward(u, readout) - v) * pair.sensory.scale.span * 1e3
    inverse = np.abs(np.clip(pair.inverse(v, u, readout), 0.0, 1.0) - u)
    return np.concatenate([forward, np.degrees(inverse * pair.motor.scale.span)], axis=1)


def table(networks: list[tuple[str, int, float | None]], n: int, seeds: int) -> None:
    """Mean and largest errors of each network and readout."""
    for network, side, sigma in networks:
        runs = [trained(network, side, n, seed, sigma) for seed in range(seeds)]
        label = f"{network} {side}x{side}" + ("" if sigma is None else f", last radius {sigma:g}")
        for readout in ("activity", "linear"):
            found = [errors(pair, u, v, readout) for pair, u, v, _ in runs]
            mean = np.mean([e.mean(axis=0) for e in found], axis=0)
            most = np.mean([e.max(axis=0) for e in found], axis=0)
            cells = " | ".join(f"{a:.3f} ({b:.2f})" for a, b in zip(mean, most, strict=True))
            print(f"| {label} | {readout} | {cells} |", flush=True)


def small(seeds: int) -> None:
    """Errors of the default varying density over those of the plain map on small lattices.

    Each seed gives one ratio, of the same samples and test points; their mean and its standard
    error are printed, forward and of the joints.
    """
    print("| nodes | rows | " + " | ".join(f"{r} x, y; joints" for r in MAP_READOUTS) + " |")
    for side in (6, 8, 10, 14, 20, 30):
        for n in (500, 2000, 20_000):
            ratio = np.array([_ratio(side, n, seed) for seed in range(seeds)])
            mean, error = ratio.mean(axis=0), ratio.std(axis=0, ddof=1) / np.sqrt(seeds)
            cells = [
                "; ".join(f"{m:.3f} +- {e:.3f}" for m, e in zip(*both, strict=True))
                for both in zip(mean, error, strict=True)
            ]
            print(f"| {side}x{side} | {n} | " + " | ".join(cells) + " |", flush=True)


def _ratio(side: int, n: int, seed: int) -> np.ndarray:
    """Mean errors (readouts, 2) of the varying density over those of the plain map."""
    found = []
    for network in ("vdsom", "som"):
        pair, u, v, _ = trained(network, side, n, seed)
        each = [errors(pair, u, v, readout).mean(axis=0) for readout in MAP_READOUTS]
        found.append([(e[:2].sum(), e[2:].sum()) for e in each])
    return np.divide(*found)


def joints() -> None:
    """Quantization error in three and six joints, and the time of one process."""
    rng = np.random.default_rng(0)
    plane, cube = (70, 70), (17, 17, 17)
    for dof in (3, 6):
        u, fresh = rng.random((20_000, dof)), rng.random((5000, dof))
        for network, shape in (
            ("som", plane),
            ("som", cube),
            ("rows", plane),
            ("gas", plane),
            ("gng", plane),
        ):
            started = time.process_time()
            found = calib.SOM(shape, network).fit(u)
            seconds = time.process_time() - started
            size = "x".join(map(str, shape))
            error = found.quantization_error(fresh)
            print(
                f"| {dof} joints | {network} {size} | {error:.4f} | {seconds:.2f} s |", flush=True
            )


def rules(n: int, seeds: int) -> None:
    """Where the paper's rule and the batch rule come to, and in which processor time."""
    for network in ("som", "vdsom", "vdsom:residual"):
        for label, how in (
            ("online, 5 passes", {"rule": "online"}),
            ("batch, 20 epochs from a random start", {"epochs": 20}),
            ("batch, coarse to fine", {}),
        ):
            runs = [trained(network, 30, n, seed, **how) for seed in range(seeds)]
            quantized = np.mean([pair.sensory.nearest(v)[0].mean() for pair, _, v, _ in runs])
            miss = np.mean([errors(*run[:3], "activity").mean(axis=0) for run in runs], axis=0)
            cells = " | ".join(f"{e:.3f}" for e in miss)
            seconds = np.median([run[3] for run in runs])
            print(
                f"| {network}, {label} | {quantized:.5f} | {cells} | {seconds:.2f} s |", flush=True
            )


def times(n: int, seeds: int) -> None:
    """Processor time of maps and links, 70x70 nodes: one network after the other, each seed."""
    networks = ("som", "vdsom:residual", "vdsom")
    found = np.array([[trained(k, 70, n, seed)[3] for k in networks] for seed in range(seeds)])
    for network, seconds, ratio in zip(networks, found.T, (found / found[:, :1]).T, strict=True):
        print(f"| {network} | {np.median(seconds):.2f} s | {np.median(ratio):.2f} |")


def main() -> None:
    """Print one part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("linear", "small", "rho", "rules", "joints", "time"))
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    with one_blas_thread():
        if given.part == "linear":
            names = ("som", "vdsom", "vdsom:residual")
            table([(n, s, None) for s in (70, 50, 30) for n in names], given.samples, given.seeds)
        elif given.part == "rho":
            names = ("som", "vdsom:rho", "vdsom:border")
            table([(n, 70, s) for s in (2.0, 1.0) for n in names], given.samples, given.seeds)
        elif given.part == "small":
            small(given.seeds)
        elif given.part == "rules":
            rules(given.samples, given.seeds)
        elif given.part == "time":
            times(given.samples, given.seeds)
        else:
            joints()


if __name__ == "__main__":
    main()
