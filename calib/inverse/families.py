"""Families: of redundant joints one member of each connected family that reaches a position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from .newton import Newton, shortened
from .settings import SEARCH
from .ways import by_middle, distinct


@dataclass(frozen=True)
class FamilySettings:
    """How solutions are joined: lengths are shares of the joints' ranges."""

    step: float = 0.03  # along a self-motion
    walk: int = 60  # most steps from one solution to another
    # share of the way ahead that a step has to be able to go
    stuck: float = 0.05
    same: float = 1e-2  # solutions that are closer are of one family


FAMILIES = FamilySettings()


def representatives(
    newton: Newton, target: Index, u: Array, x: Array
) -> tuple[Index, Array, Array]:
    """Of solutions (n, dof) of targets (n,) the most central one of each connected family.

    Each slides as far towards the middle of the ranges as it can; of those two are of one family if
    small steps along the self-motion, on target and inside of the limits, lead from one to the
    other.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    middle = np.full_like(u, 0.5)
    central, miss = newton.settle(u, x[target], middle, FAMILIES.step)
    central = np.where(newton.met(miss)[:, None], central, u)
    target, u, miss = by_middle(newton.scale, target, central, miss)
    single = distinct(newton.scale, target, u, FAMILIES.same)
    target = target[single]
    u = u[single]
    a, b = np.nonzero(np.tril(target[:, None] == target, -1))
    arrived = _arrives(newton, u[a], u[b], x[target[a]])
    ways = np.array([a[arrived], b[arrived]])
    graph = coo_array(
        (np.ones(ways.shape[1]), tuple(ways)), shape=2 * u.shape[:1]
    )
    label = connected_components(graph.tocsr())[1]
    first = np.unique(label, return_index=True)[1]
    first = np.sort(first)
    return target[first], u[first], miss[single][first]


def _arrives(newton: Newton, start: Array, goal: Array, x: Array) -> Mask:
    """Whether steps along the self-motion lead from `start` to `goal`, (n,)."""
    arrived = np.zeros(len(start), dtype=bool)
    rows = np.arange(len(start))
    u = start.copy()
    for _ in range(FAMILIES.walk):
        wish = newton.scale.difference(goal[rows], u[rows])
        ahead = np.linalg.norm(wish, axis=1)
        near = ahead < 0.3 * FAMILIES.step
        arrived[rows[near]] = True
        rows = rows[~near]
        if not len(rows):
            break
        ahead = ahead[~near]
        slope = newton.task.residual(u[rows], x[rows])[1]
        move = newton.tangent(u[rows], slope, wish[~near])
        step = shortened(move, FAMILIES.step)
        trial, miss = newton.refine(u[rows] + step, x[rows], SEARCH.close)
        free = np.linalg.norm(move, axis=1) > FAMILIES.stuck * ahead
        small = newton.away(trial, u[rows]) < 2 * FAMILIES.step
        nearer = newton.away(trial, goal[rows]) < ahead
        going = free & small & nearer & newton.met(miss)
        u[rows] = trial
        rows = rows[going]
    return arrived


def free_directions(jacobian: Array) -> Array:
    """Directions (k, dof) that leave what a Jacobian (m, dof) reaches, each with a joint at 1."""
    from scipy.linalg import qr

    _, size, vt = np.linalg.svd(jacobian)
    null = vt[int((size > 1e-6 * size[0]).sum()) :]
    if not len(null):
        return null
    leading = np.sort(qr(null, mode="r", pivoting=True)[1][: len(null)])
    return np.asarray(np.linalg.solve(null[:, leading], null))
