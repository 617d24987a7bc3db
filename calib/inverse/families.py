"""Families: of redundant joints one member of each connected family that reaches a position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from .newton import Newton, shortened
from .search import rank_within
from .settings import SEARCH


@dataclass(frozen=True)
class FamilySettings:
    """How solutions are joined: lengths are shares of the joints' ranges."""

    step: float = 0.03  # along a self-motion
    walk: int = 60  # most steps from one solution to another
    # share of the way ahead that a step has to be able to go
    stuck: float = 0.05
    rounds: int = 7  # attempts, each of twice as many pairs of a group
    # solutions of the same target that one may be joined with
    nearest: int = 31


FAMILIES = FamilySettings()


def representatives(
    newton: Newton, target: Index, u: Array, x: Array
) -> tuple[Index, Array]:
    """Of solutions (n, dof) of targets (n,) the most central one of each connected family.

    Two are of one family if small steps along the self-motion, on target and inside of the limits,
    lead from one to the other.
    """
    label = _families(newton, target, u, x)
    middle = np.full_like(u, 0.5)
    order = np.lexsort((newton.away(u, middle), label))
    first = np.append(True, np.diff(label[order]) > 0)
    chosen = np.sort(order[first])
    target = target[chosen]
    u = u[chosen]
    central, miss = newton.settle(
        u, x[target], middle[chosen], longest=FAMILIES.step
    )
    return target, np.where(newton.met(miss)[:, None], central, u)


def _families(newton: Newton, target: Index, u: Array, x: Array) -> Index:
    """The family of each solution (n,): each group tries the nearest of others, more and more."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    a, b, gap = _pairs(newton, target, u)
    label = np.arange(len(u))
    ways = np.zeros((2, 0), dtype=np.intp)
    for attempt in range(FAMILIES.rounds):
        other = np.flatnonzero(label[a] != label[b])
        if not len(other):
            break
        # the shortest ways out of each group
        order = other[np.lexsort((gap[other], label[a[other]]))]
        tried = order[rank_within(label[a[order]]) < 2**attempt]
        arrived = _arrives(
            newton, u[a[tried]], u[b[tried]], x[target[a[tried]]]
        )
        joined = tried[arrived]
        ways = np.hstack([ways, np.array([a[joined], b[joined]])])
        graph = coo_array(
            (np.ones(ways.shape[1]), tuple(ways)), shape=(len(u), len(u))
        )
        label = connected_components(graph.tocsr())[1].astype(np.intp)
        a = np.delete(a, tried)
        b = np.delete(b, tried)
        gap = np.delete(gap, tried)
    return label


def _pairs(
    newton: Newton, target: Index, u: Array
) -> tuple[Index, Index, Array]:
    """Pairs of solutions of the same target, each with those nearest to it, and their distances."""
    rows = [target[:0]]
    columns = [target[:0]]
    gaps = [np.zeros(0)]
    for group in np.split(
        np.arange(len(u)), np.flatnonzero(np.diff(target)) + 1
    ):
        gap = newton.away(u[group, None], u[group])
        near = np.argsort(gap, axis=1)[:, 1 : FAMILIES.nearest + 1]
        rows.append(np.repeat(group, near.shape[1]))
        columns.append(group[near].ravel())
        gaps.append(np.take_along_axis(gap, near, axis=1).ravel())
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(gaps)


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
        move = newton.tangent(u[rows], x[rows], wish[~near])
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
