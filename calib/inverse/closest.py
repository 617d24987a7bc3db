"""Closest: joints whose tip comes nearest to a position that nothing reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .newton import Newton, Stand, lengths, limit_length
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
    origin = np.zeros(x.shape)
    stand = newton.at(u, origin)
    share = np.ones(len(u))
    rows = np.arange(len(u))
    for _ in range(SEARCH.steps):
        if not len(rows):
            break
        here = stand.rows(rows)
        missing = x[rows] + here.gap
        gap = limit_length(missing, newton.task.size)
        whole_step = _second_order_step(newton, here, gap)
        step = share[rows, None] * whole_step
        trial = newton.at(here.u + step, here.x)
        gap_after = gap + trial.gap - here.gap
        better = lengths(gap_after) < lengths(gap)
        stand.put(rows[better], trial.rows(better))
        longer = np.minimum(1.0, 2 * share[rows])
        shorter = share[rows] / 4
        share[rows] = np.where(better, longer, shorter)
        moved = newton.scale.difference(trial.u, here.u)
        furthest = np.abs(moved).max(axis=1)
        going = furthest > CLOSEST.still
        going &= share[rows] > CLOSEST.least_share
        rows = rows[going]
    missing = x + stand.gap
    return stand.u, lengths(missing)


def _second_order_step(newton: Newton, stand: Stand, gap: Array) -> Array:
    """Newton step (n, dof) of half the squared distance, with the joints that may move.

    ``H^-1 J' gap`` with the curvature ``H = J' J - sum(gap_i J_i')`` of Jacobians (n, m, dof), by
    the sizes of its eigenvalues: a saddle is left as a top is.
    """
    u = stand.u
    slope = stand.slope
    column = gap[:, :, None]
    push = (slope * column).sum(axis=1)
    at_lower = u <= 0.0
    at_upper = u >= 1.0
    stuck = at_lower & (push < 0.0)
    stuck |= at_upper & (push > 0.0)
    stuck &= ~newton.scale.periodic
    push[stuck] = 0.0
    curvature = np.swapaxes(slope, 1, 2) @ slope
    dof = u.shape[1]
    probes = SEARCH.probe * np.eye(dof)
    for k, probe in enumerate(probes):
        _, ahead = newton.task.residual(u + probe, stand.x)
        change = (ahead - slope) / SEARCH.probe
        bend = change * column
        curvature[:, k] -= bend.sum(axis=1)
    transposed = np.swapaxes(curvature, 1, 2)
    curvature = curvature + transposed
    # joints that are stuck have neither rows nor columns
    curvature[stuck] = 0.0
    columns = np.swapaxes(curvature, 1, 2)
    columns[stuck] = 0.0
    signed, axes = np.linalg.eigh(0.5 * curvature)
    size = np.abs(signed)
    largest = size.max(axis=1, keepdims=True)
    least = np.maximum(CLOSEST.flat * largest, 1e-300)
    size = np.maximum(size, least)
    along = push[:, None] @ axes
    amounts = along[:, 0] / size
    steps = axes @ amounts[..., None]
    step = steps[..., 0]
    free_step = np.where(stuck, 0.0, step)
    return limit_length(free_step, CLOSEST.far)
