"""Figures of docs/paper.md and docs/maps.md: readouts, small lattices, eq. 7 and 8, many joints.

python benchmarks/map_readouts.py linear|small|rho|rules|joints|time [--samples N] [--seeds N]
"""

import argparse
import time

import numpy as np
from tables import table

import calib
from calib.common.choices import MAP_READOUTS
from calib.common.parallel import one_blas_thread
from calib.common.scale import Scale
from calib.maps.association import Association
from calib.training.maps import associate
from calib.training.options import TrainingOptions

ROBOT = "two_link"
TESTED = 10_000
COLUMNS = ("x [mm]", "y [mm]", "shoulder [deg]", "elbow [deg]")


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
    inverse = np.abs(np.clip(pair.inverses(v, u)[readout], 0.0, 1.0) - u)
    return np.concatenate([forward, np.degrees(inverse * pair.motor.scale.span)], axis=1)


def readouts(networks: list[tuple[str, int, float | None]], n: int, seeds: int) -> None:
    """Mean and largest errors of each network and readout."""
    rows = []
    for network, side, sigma in networks:
        runs = [trained(network, side, n, seed, sigma) for seed in range(seeds)]
        label = f"{network} {side}x{side}" + ("" if sigma is None else f", last radius {sigma:g}")
        for readout in ("activity", "linear"):
            found = [errors(pair, u, v, readout) for pair, u, v, _ in runs]
            mean = np.mean([e.mean(axis=0) for e in found], axis=0)
            most = np.mean([e.max(axis=0) for e in found], axis=0)
            cells = [f"{a:.3f} ({b:.2f})" for a, b in zip(mean, most, strict=True)]
            rows.append({"network": label, "readout": readout}
                        | dict(zip(COLUMNS, cells, strict=True)))  # fmt: skip
    table("Mean (largest) errors", rows)


def small(seeds: int) -> None:
    """Errors of the default varying density over those of the plain map on small lattices.

    Each seed gives one ratio, of the same samples and test points; their mean and its standard
    error are printed, forward and of the joints.
    """
    rows = []
    for side in (6, 8, 10, 14, 20, 30):
        for n in (500, 2000, 20_000):
            ratio = np.array([_ratio(side, n, seed) for seed in range(seeds)])
            mean, error = ratio.mean(axis=0), ratio.std(axis=0, ddof=1) / np.sqrt(seeds)
            told = np.stack([mean, error], axis=-1)
            cells = ["; ".join(f"{m:.3f} +- {e:.3f}" for m, e in both) for both in told]
            rows.append({"nodes": f"{side}x{side}", "rows": n}
                        | dict(zip(MAP_READOUTS, cells, strict=True)))  # fmt: skip
    table("Positions; joints", rows)


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
    rng, rows = np.random.default_rng(0), []
    plane, cube = (70, 70), (17, 17, 17)
    maps = ("som", plane), ("som", cube), ("gng", plane)
    for dof in (3, 6):
        u, fresh = rng.random((20_000, dof)), rng.random((5000, dof))
        for network, shape in maps:
            started = time.process_time()
            found = calib.SOM(shape, network).fit(u)
            seconds = time.process_time() - started
            rows.append({"joints": dof, "network": network, "nodes": "x".join(map(str, shape)),
                         "error": found.quantization_error(fresh), "seconds": seconds})  # fmt: skip
    table("Quantization error", rows)


def rules(n: int, seeds: int) -> None:
    """Where the paper's rule and the batch rule come to, and in which processor time."""
    rows = []
    for network in ("som", "vdsom", "vdsom:residual"):
        for label, how in (
            ("online, 5 passes", {"rule": "online"}),
            ("batch, 20 epochs from a random start", {"epochs": 20}),
            ("batch, coarse to fine", {}),
        ):
            runs = [trained(network, 30, n, seed, **how) for seed in range(seeds)]
            quantized = np.mean([pair.sensory.nearest(v)[0].mean() for pair, _, v, _ in runs])
            miss = np.mean([errors(*run[:3], "activity").mean(axis=0) for run in runs], axis=0)
            rows.append({"map": f"{network}, {label}", "quantization": float(quantized)}
                        | dict(zip(COLUMNS, miss.tolist(), strict=True))
                        | {"seconds": float(np.median([run[3] for run in runs]))})  # fmt: skip
    table("Rules, readout activity", rows)


def times(n: int, seeds: int) -> None:
    """Processor time of maps and links, 70x70 nodes: one network after the other, each seed."""
    networks = ("som", "vdsom:residual", "vdsom")
    found = np.array([[trained(k, 70, n, seed)[3] for k in networks] for seed in range(seeds)])
    ratio = np.median(found / found[:, :1], axis=0)
    told = zip(networks, np.median(found, axis=0).tolist(), ratio.tolist(), strict=True)
    table("Time", ({"network": name, "seconds": s, "over som": r} for name, s, r in told))


def main() -> None:
    """Print one part."""
    parts = ("linear", "small", "rho", "rules", "joints", "time")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=parts)
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    n, seeds = given.samples, given.seeds
    plain = [(k, s, None) for s in (70, 50, 30) for k in ("som", "vdsom", "vdsom:residual")]
    radii = [(k, 70, s) for s in (2.0, 1.0) for k in ("som", "vdsom:rho", "vdsom:border")]
    runs = {
        "linear": lambda: readouts(plain, n, seeds),
        "rho": lambda: readouts(radii, n, seeds),
        "small": lambda: small(seeds),
        "rules": lambda: rules(n, seeds),
        "time": lambda: times(n, seeds),
        "joints": joints,
    }
    with one_blas_thread():
        runs[given.part]()


if __name__ == "__main__":
    main()
