"""Closest: joints whose tip comes nearest to a position that nothing reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .newton import Newton, shortened
from .settings import SEARCH


@dataclass(frozen=True)
class ClosestSettings:
    """Lengths are shares of the joints' ranges unless said."""

    far: float = 0.2  # longest step
    still: float = 1e-10  # a step that is shorter is the last
    least_share: float = 1e-6  # of a step
    # of the largest curvature, which every direction has at least
    flat: float = 1e-6


CLOSEST = ClosestSettings()


def closest(newton: Newton, u: Array, x: Array) -> tuple[Array, Array]:
    """Joints (n, dof) that come nearest to positions `x` (n, m) from `u`, and what is missing (n,).

    Newton steps with second derivatives: the edge of the workspace is curved, of which the Jacobian
    alone knows nothing.  A far target counts as one workspace away: the nearest point is the same
    for all targets along one normal of its edge.
    """
    task = newton.task
    u = u.copy()
    share = np.ones(len(u))
    origin = np.zeros(x.shape)
    back, slope = task.residual(u, origin)  # from the tip to the origin
    rows = np.arange(len(u))
    for _ in range(SEARCH.steps):
        if not len(rows):
            break
        gap = shortened(x[rows] + back[rows], task.size)
        step = _curved_step(newton, u[rows], gap, slope[rows])
        trial = newton.clip(u[rows] + share[rows, None] * step)
        trial_back, trial_slope = task.residual(trial, origin[rows])
        # compared with what is pulled close: far targets have no digits left to compare
        after = gap + trial_back - back[rows]
        better = np.linalg.norm(after, axis=1) < np.linalg.norm(gap, axis=1)
        moved = np.abs(newton.scale.difference(trial, u[rows])).max(axis=1)
        nearer = rows[better]
        u[nearer] = trial[better]
        back[nearer] = trial_back[better]
        slope[nearer] = trial_slope[better]
        longer = np.minimum(1.0, 2 * share[rows])
        share[rows] = np.where(better, longer, share[rows] / 4)
        going = (moved > CLOSEST.still) & (share[rows] > CLOSEST.least_share)
        rows = rows[going]
    return u, np.linalg.norm(x + back, axis=1)


def _curved_step(newton: Newton, u: Array, gap: Array, slope: Array) -> Array:
    """Newton step (n, dof) of half the squared distance, with the joints that may move."""
    origin = np.zeros(gap.shape)
    push = (slope * gap[:, :, None]).sum(axis=1)
    outward = ((u <= 0.0) & (push < 0.0)) | ((u >= 1.0) & (push > 0.0))
    stuck = outward & ~newton.scale.periodic
    curvature = np.swapaxes(slope, 1, 2) @ slope
    for k, probe in enumerate(SEARCH.probe * np.eye(u.shape[1])):
        ahead = newton.task.residual(u + probe, origin)[1]
        behind = newton.task.residual(u - probe, origin)[1]
        change = (ahead - behind) / (2 * SEARCH.probe)
        curvature[:, k] -= (change * gap[:, :, None]).sum(axis=1)
    curvature = 0.5 * (curvature + np.swapaxes(curvature, 1, 2))
    curvature[stuck[:, :, None] | stuck[:, None, :]] = 0.0
    size, axes = np.linalg.eigh(curvature)
    size = np.abs(size)
    largest = np.maximum(size.max(axis=1, keepdims=True), 1e-300)
    size = np.maximum(size, CLOSEST.flat * largest)
    along = (np.where(stuck, 0.0, push)[:, None] @ axes)[:, 0] / size
    step = (axes @ along[..., None])[..., 0]
    return shortened(np.where(stuck, 0.0, step), CLOSEST.far)
