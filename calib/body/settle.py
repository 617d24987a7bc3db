"""Robust Levenberg-Marquardt steps from anywhere: what starts are brought to their optimum by."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .normal import slices
from .parameters import Prior
from .search import Search
from .settings import STUDENT
from .structure import Structure

_SETTLED = 1e-3
"""Share of a parameter's own sd below which a step ends a run."""


def _spread(r: Array, extents: Array, blocks: tuple[int, ...]) -> Array:
    """Maximum-likelihood Student scale (m,) of residuals, at least 1e-7 of the extents."""
    sigma = np.empty(r.shape[1])
    for part in slices(blocks):
        p, least = part.stop - part.start, 1e-14 * extents[part.start] ** 2
        e2 = (r[:, part] ** 2).sum(axis=1)
        s2 = float(np.median(e2)) / p + least
        for _ in range(12):
            s2 = float(((STUDENT + p) / (STUDENT + e2 / s2) * e2).mean()) / p + least
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
    search = Search(structure, q, z, beta, prior, STUDENT, np.zeros(structure.outputs))
    search.edges = np.array([0, len(z)])  # nothing is held out
    damping = 1e-3
    with np.errstate(all="ignore"):
        for _ in range(steps):
            search.noise = _spread(search.r, structure.extents, search.blocks)
            search.linearise(fresh=True)
            gain, moved, damping = search.descend(damping)
            if not gain or moved < _SETTLED:
                break
            damping = max(damping / 10, 1e-12)
        search.noise = _spread(search.r, structure.extents, search.blocks)
        cost = search.objective(search.beta, search.r)
    return search.beta, cost, float((search.noise / structure.extents).max())
