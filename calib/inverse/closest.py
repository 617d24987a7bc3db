"""Closest: the attainable point that is nearest to a target out of reach."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .newton import Newton

_STEPS = 40  # most iterations
_PROBE = 1e-4  # of the joints' range: step of the second derivatives
_LONGEST = 0.2  # of the joints' range: no step is longer
_STILL = 1e-10  # of the joints' range: a shorter step is the last
_FLAT = 1e-6  # share of the largest curvature that every direction has at least


def closest(newton: Newton, u: Array, x: Array) -> tuple[Array, Array]:
    """Joints (n, dof) that come nearest to targets `x` (n, m), and the distances (n,) left.

    Newton steps on the distance from `u` (n, dof, unit box), with second derivatives: at the edge
    of the workspace the Jacobian alone says little of how the distance grows, because the edge
    itself is curved. The way to a far target counts as no longer than the workspace: the nearest
    point is the same for all targets along one normal of its edge.
    """
    u = u.copy()
    position, slope = newton.task.value_and_slope(u)
    distance = np.linalg.norm(x - position, axis=1)
    share = np.ones(len(u))
    rows = np.arange(len(u))
    for _ in range(_STEPS):
        if not len(rows):
            break
        gap = x[rows] - position[rows]
        gap *= np.minimum(1.0, newton.extent / np.maximum(distance[rows], 1e-300))[:, None]
        step = _step(newton, u[rows], slope[rows], gap) * share[rows, None]
        trial = newton.clip(u[rows] + step)
        there, tilt = newton.task.value_and_slope(trial)
        # compared with what is pulled close: far targets have no digits left to compare
        now = np.linalg.norm(position[rows] + gap - there, axis=1)
        better = now < np.linalg.norm(gap, axis=1)
        moved = np.abs(newton.scale.difference(trial, u[rows])).max(axis=1)
        taken = rows[better]
        u[taken], position[taken], slope[taken] = trial[better], there[better], tilt[better]
        distance[taken] = np.linalg.norm(x[taken] - position[taken], axis=1)
        share[rows] = np.where(better, np.minimum(1.0, 2 * share[rows]), share[rows] / 4)
        rows = rows[(moved > _STILL) & (share[rows] > 1e-6)]
    return u, distance


def _step(newton: Newton, u: Array, slope: Array, gap: Array) -> Array:
    """Newton step (n, dof) of half the squared distance, with the joints that may move."""
    dof = u.shape[1]
    push = np.einsum("noi,no->ni", slope, gap)
    held = ((u <= 0.0) & (push < 0.0) | (u >= 1.0) & (push > 0.0)) & ~newton.scale.periodic
    curvature = np.einsum("noi,noj->nij", slope, slope)
    for k in range(dof):
        probe = np.zeros(dof)
        probe[k] = _PROBE
        ahead = newton.task.value_and_slope(u + probe)[1]
        behind = newton.task.value_and_slope(u - probe)[1]
        curvature[:, k] -= np.einsum("noi,no->ni", ahead - behind, gap) / (2 * _PROBE)
    curvature = 0.5 * (curvature + np.swapaxes(curvature, 1, 2))
    curvature[held[:, :, None] | held[:, None, :]] = 0.0
    size, axes = np.linalg.eigh(curvature)
    size = np.abs(size)
    size = np.maximum(size, _FLAT * np.maximum(size.max(axis=1, keepdims=True), 1e-300))
    push = np.where(held, 0.0, push)
    step = np.einsum("nij,nj->ni", axes, np.einsum("nji,nj->ni", axes, push) / size)
    step = np.where(held, 0.0, step)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300)))
