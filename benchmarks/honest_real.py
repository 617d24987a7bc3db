"""Honesty on real rows: coverage of the bound, gaps, errors of ten blocks, a corrected URDF."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from honest_worlds import Row, distance, row

import calib

Array = Any

JOINTS = ["shoulder_lift_joint", "elbow_joint"]
SERIES = ("a", "c")


@cache
def series(folder: Path, name: str) -> calib.Samples:
    """One series, without a robot: ranges are the data's, positions in m."""
    return calib.read_log(folder / f"series_{name}.csv", joints=JOINTS)


def nominal_urdf(name: str = "ur10_robot") -> Path:
    """A URDF of PyPI example-robot-data, the UR10's."""
    import pinocchio

    root = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"
    return next(root.rglob(f"{name}.urdf"))


def halves(n: int, blocks: int) -> list[tuple[Array, Array]]:
    """Every second of some contiguous blocks, and the others; both ways."""
    parts = np.array_split(np.arange(n), blocks)
    even, odd = np.concatenate(parts[::2]), np.concatenate(parts[1::2])
    return [(even, odd), (odd, even)]


def coverage(folder: Path, quick: bool) -> Iterator[Row]:
    """Share of the other half's rows within `expected_error`."""
    shares, answered = [], []
    for name in SERIES:
        log = series(folder, name)
        for blocks in (2, 20) if quick else (2, 4, 10, 20):
            for learned, asked in halves(len(log), blocks)[: 1 if quick else 2]:
                inside, known = _covered(calib.train(log.take(learned)), log.take(asked))
                shares.append(inside)
                answered.append(known)
    yield row(
        f"coverage of other halves of A and C, mean of {len(shares)}",
        100 * float(np.mean(shares)),
        "%",
        least=94,
        most=98,
    )
    yield row(
        "the same, least of all",
        100 * float(np.min(shares)),
        "%",
        least=87,
        more="all: " + ", ".join(f"{100 * s:.0f}" for s in shares),
    )
    yield _answered(answered)


def _covered(model: calib.Model, log: calib.Samples) -> tuple[float, float]:
    """Share of the answered rows within the bound, and share answered."""
    miss, bound = distance(model.forward(log.q), log.x), model.expected_error(log.q)
    known = np.isfinite(miss) & np.isfinite(bound)
    return float(np.mean(miss[known] <= bound[known])), float(known.mean())


def _answered(shares: list[float]) -> Row:
    return row("the same, rows answered, least of all", 100 * float(np.min(shares)), "%", least=95)


def gap_splits(log: calib.Samples) -> list[tuple[str, Array, Array]]:
    """Each joint's lowest, middle and highest 15 % of its range removed."""
    found = []
    for k, joint in enumerate(log.joint_names):
        low, high = log.q[:, k].min(), log.q[:, k].max()
        share = (log.q[:, k] - low) / (high - low)
        for where, start in (("lowest", 0.0), ("middle", 0.425), ("highest", 0.85)):
            gone = (share >= start) & (share <= start + 0.15)
            found.append((f"{joint} {where}", np.flatnonzero(~gone), np.flatnonzero(gone)))
    return found


def gaps(folder: Path, quick: bool) -> Iterator[Row]:
    """Share of the removed rows within `expected_error`."""
    shares, answered, told = [], [], []
    for name in SERIES:
        log = series(folder, name)
        for what, learned, gone in gap_splits(log)[:: 2 if quick else 1]:
            inside, known = _covered(calib.train(log.take(learned)), log.take(gone))
            shares.append((len(gone), inside))
            answered.append(known)
            told.append(f"{name} {what} {len(gone)} rows {100 * inside:.0f}")
    yield row(
        f"coverage within {len(shares)} gaps, mean",
        100 * float(np.mean([s for _, s in shares])),
        "%",
        least=93,
        more="; ".join(told),
    )
    yield row(
        "the same, least of those with 50 rows or more",
        100 * float(np.min([s for n, s in shares if n >= 50])),
        "%",
        least=85,
    )
    yield _answered(answered)


def _blocks_error(log: calib.Samples, n: int | None, quick: bool) -> float:
    """Mean distance [mm] on held-out blocks, learned from n rows of the others."""
    blocks, errors = np.array_split(np.arange(len(log)), 10), []
    for k, held in enumerate(blocks):
        if quick and k % 5 != 2:
            continue
        others = np.setdiff1d(np.arange(len(log)), held)
        if n is not None:
            others = np.sort(np.random.default_rng(k).permutation(others)[:n])
        said = calib.train(log.take(others)).forward(log.q[held])
        errors.append(1e3 * float(np.nanmean(distance(said, log.x[held]))))
    return float(np.mean(errors))


def rows(folder: Path, quick: bool) -> Iterator[Row]:
    """Mean error on ten blocks, each held out, learned from some or all of the other rows."""
    bars = {
        "a": {100: 0.25, 300: 0.22, 1500: 0.21, None: 0.20},
        "c": {100: 0.26, 300: 0.245, None: 0.235},
    }
    for name, limits in bars.items():
        for n, most in limits.items():
            if quick and n is None:
                continue
            yield row(
                f"series {name.upper()}, {n or 'all'} rows, held-out blocks",
                _blocks_error(series(folder, name), n, quick),
                "mm",
                most=most,
            )


def few(folder: Path, quick: bool) -> Iterator[Row]:
    """The same from 30 rows."""
    for name, most in (("a", 0.30), ("c", 0.31)):
        yield row(
            f"series {name.upper()}, 30 rows, held-out blocks, without URDF",
            _blocks_error(series(folder, name), 30, quick),
            "mm",
            most=most,
        )


def urdf(folder: Path, quick: bool) -> Iterator[Row]:
    """A URDF corrected from the even blocks of C, tested on the odd ones in a rigid frame."""
    del quick
    log = series(folder, "c")
    even, odd = halves(len(log), 10)[0]
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        calib.write_log(log.take(even), place / "even.csv")
        options = ["--joints", ",".join(JOINTS), "--tip", "wrist_1_link"]
        train = ["train", str(nominal_urdf()), "--data", "even.csv", *options, "-o", "m.calib"]
        for command in (train, ["urdf", "m.calib", "-o", "new.urdf"]):
            command = [sys.executable, "-m", "calib_cli", *command]
            subprocess.run(command, cwd=place, check=False, capture_output=True)
        arms = [calib.load_arm(nominal_urdf(), joints=JOINTS, tip="wrist_1_link")]
        if (place / "new.urdf").exists():
            arms.append(calib.load_arm(place / "new.urdf", joints=JOINTS, tip="wrist_1_link"))
    errors = [_framed(arm, log, even, odd) for arm in arms]
    yield row(
        "URDF corrected from even blocks of C, on odd blocks",
        errors[1] if len(errors) > 1 else float("nan"),
        "mm",
        most=0.349,
        more=f"nominal {errors[0]:.3f}",
    )


def _framed(arm: calib.PlanarArm, log: calib.Samples, fitted: Array, tested: Array) -> float:
    """Mean error [mm] of an arm's kinematics in the rigid frame that fits some rows best."""
    p = arm.forward(log.q)[:, :2] @ np.array([1.0, 1j])
    z = log.x @ np.array([1.0, 1j])
    best = np.inf
    for points in (p, p.conj()):
        middle = points[fitted].mean()
        turn = np.vdot(points[fitted] - middle, z[fitted] - z[fitted].mean())
        said = (points - middle) * turn / abs(turn) + z[fitted].mean()
        if np.abs(said - z)[fitted].mean() < best:
            best = np.abs(said - z)[fitted].mean()
            error = 1e3 * float(np.abs(said - z)[tested].mean())
    return error
