"""Cases of the ablation: logs of two joints with an independent truth, and blocks of real logs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import calib

Array = Any
Defect = tuple[Callable[[Array], Array], Callable[[Array], Array]]
"""Positions (n, 2) of joints (n, 2), and which of these lie in the defect."""

STREAM = 91  # of the points on which errors are measured


@dataclass(frozen=True, eq=False)
class Case:
    """A log and what is true of it."""

    name: str
    samples: calib.Samples  # what is learned from
    # (n, dof), (n, 2), joints and positions that were not learned
    q: Array
    x: Array
    defect: Array  # (n,), which of them lie in a defect


def bump(arm: Any) -> Defect:
    """The arm with a bump of 3 mm that depends on both joints, 1.5 deg wide."""

    def away(q: Array) -> Array:
        return np.linalg.norm(np.degrees(q) - (45.0, 80.0), axis=1) / 1.5

    def truth(q: Array) -> Array:
        high = 3e-3 * np.exp(-0.5 * away(q) ** 2)
        return arm.forward(q) + high[:, None] * np.array([0.8, -0.6])

    return truth, lambda q: away(q) < 2.0


def ripple(arm: Any) -> Defect:
    """The arm whose elbow is 1 deg off, 72 cycles a turn, from 60 to 75 deg."""
    low, high = np.radians([60.0, 75.0])

    def inside(q: Array) -> Array:
        return (q[:, 1] > low) & (q[:, 1] < high)

    def truth(q: Array) -> Array:
        moved = q.copy()
        moved[:, 1] += np.where(inside(q), np.radians(1.0) * np.sin(72 * (q[:, 1] - low)), 0.0)
        return arm.forward(moved)

    return truth, inside


def simulated(name: str, n: int, tested: int, seed: int) -> Case:
    """One of the simulated cases, `n` rows to learn from and `tested` ones to test on.

    name : {"exact", "bump", "ripple"}, an exact sensor, and the two defects with 0.2 mm of noise
    """
    shape = {"bump": bump, "ripple": ripple}.get(name)
    # an elbow that bends both ways gives most targets two branches
    arm = calib.load_arm("two_link" if shape else "two_link_full")
    truth, inside = shape(arm) if shape else (arm.forward, lambda q: np.zeros(len(q), dtype=bool))
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(STREAM,)))
    span = arm.upper - arm.lower
    q = arm.lower + span * rng.random((n, 2))
    fresh = arm.lower + span * rng.random((tested, 2))
    x = truth(q) + (2e-4 if shape else 0.0) * rng.standard_normal((n, 2))
    known = arm.joint_names, arm.lower, arm.upper, arm.revolute
    samples = calib.Samples(q, x, *known, arm=arm, plane=arm.plane)
    return Case(name, samples, fresh, truth(fresh), inside(fresh))


def measured(folder: Path, series: str, block: int, blocks: int) -> Case:
    """A series of a UR10 without one contiguous block of its rows, which is tested on."""
    path = folder / f"series_{series.lower()}.csv"
    samples = calib.read_log(path, joints=["shoulder_lift_joint", "elbow_joint"])
    held = np.array_split(np.arange(len(samples)), blocks)[block]
    some, rest = samples.take(np.setdiff1d(np.arange(len(samples)), held)), samples.take(held)
    return Case(f"UR10 {series}", some, rest.q, rest.x, np.zeros(len(held), dtype=bool))
