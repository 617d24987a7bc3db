"""The best of a structure's starts: short robust Levenberg-Marquardt runs without curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .normal import Factor, slices, with_prior
from .parameters import Prior
from .search import Search
from .structure import Structure

_ROWS = 400
"""Rows that the runs use at most."""

_KEPT = 8
"""Runs that are carried on after the first six steps."""

_NU = 6.0

_SETTLED = 1e-3
"""Share of a parameter's own sd below which a step ends a run."""

_RIVAL = 2.0
"""A rival's residuals are at most this many times the best start's."""

_APART = 0.05
"""Two starts are different arms where they differ by this share of the extents."""

_ASKED = 100
"""Places where two starts are compared."""


@dataclass(frozen=True)
class Start:
    """A start of the fit."""

    structure: Structure  # with its signs and mirror
    beta: Array  # (d,)
    cost: float  # negative log posterior at the start's own noise
    noise: float  # share of the extents that the residuals have


def best_starts(
    structure: Structure, q: Array, z: Array, free: tuple[str, ...]
) -> tuple[Start, ...]:
    """The best start, and a rival that explains the rows nearly as well by another arm.

    Rows along a path can be explained by two arms, of which joint curves may prefer the wrong
    one; the gate then decides with the curves.

    q : (n, dof)
    z : (n, m)
    free : groups that the runs fit; the gate's chain
    """
    box = q.min(axis=0), np.ptp(q, axis=0)
    if len(q) > _ROWS:
        rows = np.sort(np.random.default_rng(0).permutation(len(q))[:_ROWS])
        q, z = q[rows], z[rows]
    found = structure.starts(q, z)
    if len(found) == 1:  # nothing to choose from: the gate goes on from here
        return (Start(found[0][0], found[0][1], 0.0, 0.0),)

    def refined(each: Structure, beta: Array, steps: int) -> Start:
        return Start(each, *settle(each, q, z, beta, each.prior(free), steps))

    runs = [refined(each, beta, 6) for each, beta in found]
    runs.sort(key=lambda run: run.cost)
    runs = [refined(run.structure, run.beta, 40) for run in runs[:_KEPT]]
    best = runs[0]
    for run in runs:
        if run.cost < best.cost - 1e-9 * abs(best.cost):
            best = run
    ask = box[0] + np.random.default_rng(0).random((_ASKED, q.shape[1])) * box[1]
    there = best.structure.predict(ask, best.beta)
    for run in sorted(runs, key=lambda run: run.cost):
        if run.noise > _RIVAL * best.noise or not np.isfinite(run.cost):
            break
        apart = best.structure.residual(there, run.structure.predict(ask, run.beta))
        if float(np.abs(apart / best.structure.extents).max()) > max(_APART, 20 * best.noise):
            return best, run
    return (best,)


def _spread(r: Array, extents: Array, blocks: tuple[int, ...]) -> Array:
    """Maximum-likelihood Student scale (m,) of residuals, at least 1e-7 of the extents."""
    sigma = np.empty(r.shape[1])
    for part in slices(blocks):
        p, least = part.stop - part.start, 1e-14 * extents[part.start] ** 2
        e2 = (r[:, part] ** 2).sum(axis=1)
        s2 = float(np.median(e2)) / p + least
        for _ in range(12):
            s2 = float(((_NU + p) / (_NU + e2 / s2) * e2).mean()) / p + least
        sigma[part] = np.sqrt(s2)
    return sigma


def settle(
    structure: Structure, q: Array, z: Array, beta: Array, prior: Prior, steps: int
) -> tuple[Array, float, float]:
    """Fit some parameters by robust Levenberg-Marquardt steps from `beta`.

    A step below `_SETTLED` sd ends them.

    Returns beta : (d,)
    Returns cost : negative log posterior with Student noise, of which the scale was fitted
    Returns noise : share of the extents that the residuals have
    """
    search = Search(structure, q, z, beta, prior, _NU, np.zeros(structure.outputs))
    search.edges = np.array([0, len(z)])  # nothing is held out
    damping = 1e-3
    with np.errstate(all="ignore"):
        for _ in range(steps):
            search.noise = _spread(search.r, structure.extents, search.blocks)
            search.linearise(fresh=True)
            gram, moment = search.data()
            precision = with_prior(gram, search.sd, None)
            pull = moment - search.pull(search.distance(search.beta))
            diagonal = np.diag(precision).copy()
            before = search.objective(search.beta, search.r)
            for _ in range(8):
                precision[np.diag_indices(len(pull))] = (1 + damping) * diagonal
                try:
                    delta = Factor(precision).solve(pull)
                    beta, r, value = search.after(delta)
                except np.linalg.LinAlgError:
                    value = np.inf
                if value < before:
                    break
                damping = min(damping * 8, 1e8)
            else:
                break
            search.beta, search.r, damping = beta, r, max(damping / 10, 1e-12)
            if float((np.abs(delta) * np.sqrt(diagonal)).max()) < _SETTLED:
                break
        search.noise = _spread(search.r, structure.extents, search.blocks)
        cost = search.objective(search.beta, search.r)
    return search.beta, cost, float((search.noise / structure.extents).max())
