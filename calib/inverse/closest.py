"""Closest: joints whose tip comes nearest to a position that nothing reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .newton import Newton, Stand, lengths, shortened
from .settings import SEARCH


@dataclass(frozen=True)
class ClosestSettings:
    """Lengths are shares of the joints' ranges unless said."""

    far: float = 0.2  # longest step
    still: float = 1e-10  # a step that is shorter is the last
    least_share: float = 1e-6  # of a step
    # of the largest curvature, which every direction has at least
    flat: float = 1e-10


CLOSEST = ClosestSettings()


def closest(newton: Newton, u: Array, x: Array) -> tuple[Array, Array]:
    """Joints (n, dof) that come nearest to positions `x` (n, m) from `u`, and what is missing (n,).

    Newton steps with second derivatives: the edge of the workspace is curved, of which the Jacobian
    alone knows nothing.  A far target counts as one workspace away: the nearest point is the same
    for all targets along one normal of its edge.
    """
    # what is missing to the origin: far targets have no digits left to compare
    stand = newton.at(u, np.zeros(x.shape))
    share = np.ones(len(u))
    rows = np.arange(len(u))
    for _ in range(SEARCH.steps):
        if not len(rows):
            break
        here = stand.rows(rows)
        gap = shortened(x[rows] + here.gap, newton.task.size)
        step = share[rows, None] * _curved_step(newton, here, gap)
        trial = newton.at(here.u + step, here.x)
        after = gap + trial.gap - here.gap
        better = lengths(after) < lengths(gap)
        stand.put(rows[better], trial.rows(better))
        longer = np.minimum(1.0, 2 * share[rows])
        share[rows] = np.where(better, longer, share[rows] / 4)
        moved = newton.scale.difference(trial.u, here.u)
        going = np.abs(moved).max(axis=1) > CLOSEST.still
        rows = rows[going & (share[rows] > CLOSEST.least_share)]
    return stand.u, lengths(x + stand.gap)


def _curved_step(newton: Newton, stand: Stand, gap: Array) -> Array:
    """Newton step (n, dof) of half the squared distance, with the joints that may move."""
    u = stand.u
    push = (stand.slope * gap[:, :, None]).sum(axis=1)
    below = (u <= 0.0) & (push < 0.0)
    above = (u >= 1.0) & (push > 0.0)
    stuck = (below | above) & ~newton.scale.periodic
    push[stuck] = 0.0
    curvature = np.swapaxes(stand.slope, 1, 2) @ stand.slope
    probes = SEARCH.probe * np.eye(u.shape[1])
    for k, probe in enumerate(probes):
        _, ahead = newton.task.residual(u + probe, stand.x)
        change = (ahead - stand.slope) / SEARCH.probe
        curvature[:, k] -= (change * gap[:, :, None]).sum(axis=1)
    curvature += np.swapaxes(curvature, 1, 2).copy()
    curvature[stuck[:, :, None] | stuck[:, None, :]] = 0.0
    size, axes = np.linalg.eigh(0.5 * curvature)
    size = np.abs(size)
    least = CLOSEST.flat * size.max(axis=1, keepdims=True)
    size = np.maximum(size, np.maximum(least, 1e-300))
    along = (push[:, None] @ axes)[:, 0] / size
    step = (axes @ along[..., None])[..., 0]
    return shortened(np.where(stuck, 0.0, step), CLOSEST.far)
