"""Families: solutions of redundant joints that a self-motion connects are one answer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from .newton import CLOSE, Newton

_STEP = 0.03  # of the joints' range: length of a step along a self-motion
_WALK = 60  # most steps from one solution to another
_STUCK = 0.05  # share of the way ahead that a step has to be able to go
_ROUNDS = 7  # attempts to join what is still apart, each of twice as many pairs of a group
_NEAREST = 31  # solutions of the same target that one may be joined with


def representatives(newton: Newton, target: Index, u: Array, x: Array) -> tuple[Index, Array]:
    """One solution of each connected family: the one closest to the middle of the ranges.

    Two solutions belong to one family if small steps along the self-motion, on target and inside of
    the limits, lead from one to the other. Each group of solutions tries the nearest solutions of
    other groups, more and more of them, until no more can be joined. `target` (m,) says, ascending,
    to which row of `x` (n, m) each solution of `u` (m, dof, unit box) belongs; returned are the
    same of what is left.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    m = len(u)
    label = np.arange(m)
    joined: list[tuple[Index, Index]] = []
    pair = _pairs(newton, target, u)
    for round_ in range(_ROUNDS):
        a, b, gap = pair
        other = label[a] != label[b]
        a, b, gap = pair = a[other], b[other], gap[other]
        if not len(a):
            break
        # the shortest ways out of each group
        order = np.lexsort((gap, label[a]))
        group = label[a][order]
        first = order[np.arange(len(order)) - np.searchsorted(group, group) < 2**round_]
        met = _walk(newton, u[a[first]], u[b[first]], x[target[a[first]]])
        joined.append((a[first][met], b[first][met]))
        rows, columns = (np.concatenate(side) for side in zip(*joined, strict=True))
        graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(m, m))
        label = connected_components(graph.tocsr())[1].astype(np.intp)
        tried = np.zeros(len(a), dtype=bool)
        tried[first] = True
        pair = a[~tried], b[~tried], gap[~tried]
    middle = np.full_like(u, 0.5)
    away = np.linalg.norm(newton.scale.difference(u, middle), axis=1)
    order = np.lexsort((away, label))
    chosen = np.sort(order[np.append(True, np.diff(label[order]) > 0)])
    target, u = target[chosen], u[chosen]
    settled, distance = newton.settle(u, x[target], middle[chosen], longest=_STEP)
    return target, np.where((distance <= CLOSE * newton.extent)[:, None], settled, u)


def _pairs(newton: Newton, target: Index, u: Array) -> tuple[Index, Index, Array]:
    """Pairs of solutions of the same target, each with those nearest to it, and their distances."""
    rows, columns, gaps = [target[:0]], [target[:0]], [np.zeros(0)]
    for own in np.split(np.arange(len(u)), np.flatnonzero(np.diff(target)) + 1):
        gap = np.linalg.norm(newton.scale.difference(u[own, None], u[own]), axis=2)
        near = np.argsort(gap, axis=1)[:, 1 : _NEAREST + 1]
        rows.append(np.repeat(own, near.shape[1]))
        columns.append(own[near].ravel())
        gaps.append(np.take_along_axis(gap, near, axis=1).ravel())
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(gaps)


def _walk(newton: Newton, start: Array, goal: Array, x: Array) -> NDArray[np.bool_]:
    """Whether steps along the self-motion lead from `start` to `goal`, (n,)."""
    arrived = np.zeros(len(start), dtype=bool)
    rows, u = np.arange(len(start)), start
    for _ in range(_WALK):
        wish = newton.scale.difference(goal[rows], u)
        ahead = np.linalg.norm(wish, axis=1)
        near = ahead < 0.3 * _STEP
        arrived[rows[near]] = True
        rows, u, wish, ahead = rows[~near], u[~near], wish[~near], ahead[~near]
        if not len(rows):
            break
        move = newton.tangent(u, wish)
        length = np.linalg.norm(move, axis=1)
        move *= np.minimum(1.0, _STEP / np.maximum(length, 1e-300))[:, None]
        trial, distance = newton.refine(u + move, x[rows], CLOSE)
        moved = np.linalg.norm(newton.scale.difference(trial, u), axis=1)
        now = np.linalg.norm(newton.scale.difference(goal[rows], trial), axis=1)
        going = (length > _STUCK * ahead) & (distance <= CLOSE * newton.extent)
        going &= (moved < 2 * _STEP) & (now < ahead)
        rows, u = rows[going], trial[going]
    return arrived


def free_directions(jacobian: Array) -> Array:
    """Directions (k, dof) in which joints move on without changing what they reach.

    The Jacobian (m, dof) has rows of comparable size. Each direction has a joint of its own at 1
    that the others leave still.
    """
    from scipy.linalg import qr

    _, size, vt = np.linalg.svd(jacobian)
    null = vt[int((size > 1e-6 * size[0]).sum()) :]
    if not len(null):
        return null
    own = np.sort(qr(null, mode="r", pivoting=True)[1][: len(null)])
    return np.asarray(np.linalg.solve(null[:, own], null))
