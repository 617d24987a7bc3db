"""The best of a structure's starts: short robust Levenberg-Marquardt runs without curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .fit import Fit
from .planar import PlanarStructure, planar_starts
from .rows import Rows
from .settings import APART, RIVAL_START, SIMULATED_FLOOR, STUDENT
from .spatial import SpatialStructure
from .spatial_start import spatial_starts
from .structure import Structure

_TIED = 1e-2  # nats that no evidence tells apart
_ROWS, _KEPT = 400, 8  # rows that the runs use at most, and runs carried on after six steps


@dataclass(frozen=True)
class Start:
    """A start of the fit."""

    structure: Structure  # with its signs and mirror
    beta: Array  # (d,)
    cost: float = 0.0  # negative log posterior at the start's own noise
    noise: float = 0.0  # share of the extents that the residuals have


def candidates(structure: Structure, q: Array, z: Array) -> Sequence[tuple[Structure, Array]]:
    """Structures (signs, mirror, chain) with parameters (d,) to begin with, the best ones first."""
    if isinstance(structure, PlanarStructure):
        return planar_starts(structure, q, z)
    assert isinstance(structure, SpatialStructure)  # noqa: S101
    return spatial_starts(structure, q, z)


def best_starts(
    structure: Structure, q: Array, z: Array, free: tuple[str, ...]
) -> tuple[Start, ...]:
    """The best start, and a rival that explains the rows nearly as well by another arm.

    Rows along a path can be explained by two arms, of which joint curves may prefer the wrong
    one; the gate then decides with the curves.

    q, z : (n, dof) and (n, m)
    free : groups that the runs fit; the gate's chain
    """
    rng = np.random.default_rng(0)
    ask = q.min(axis=0) + rng.random((100, q.shape[1])) * np.ptp(q, axis=0)
    if len(q) > _ROWS:
        some = np.sort(np.random.default_rng(0).permutation(len(q))[:_ROWS])
        q, z = q[some], z[some]
    runs = [Start(*found) for found in candidates(structure, q, z)]
    if len(runs) == 1:  # nothing to choose from: the gate goes on from here
        return tuple(runs)
    rows = [Rows(q, z, floor=SIMULATED_FLOOR * structure.extents)]
    for steps in (6, 40):
        for k, run in enumerate(runs):
            prior = run.structure.prior(free)
            fit = Fit(run.structure, rows, run.beta, prior, nu=STUDENT)
            runs[k] = Start(run.structure, *fit.settle(steps))
        runs = sorted(runs, key=lambda run: run.cost)[:_KEPT]
    # A planar arm that turns the other way, seen from behind, fits as well: the drawing's own way.
    tied = [run for run in runs if not run.cost > runs[0].cost + _TIED]
    best = min(tied, key=lambda run: run.structure.reversals)
    there = best.structure.predict(ask, best.beta)
    for run in runs:
        apart = best.structure.residual(there, run.structure.predict(ask, run.beta))
        other = np.abs(apart / best.structure.extents).max() > max(APART, 20 * best.noise)
        if other and run.noise <= RIVAL_START * best.noise and np.isfinite(run.cost):
            return best, run
    return (best,)
