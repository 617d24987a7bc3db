"""Families: of redundant joints one member of each connected family that reaches a position.

Two solutions are of one family if small steps along the self-motion, on target and inside of the
limits, lead from one to the other: a family is a connected part of the set of all solutions.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from .newton import Newton, lengths, shortened
from .settings import SEARCH
from .slides import settle
from .ways import Ways


@dataclass(frozen=True)
class FamilySettings:
    """How solutions are joined: lengths are shares of the joints' ranges."""

    step: float = 0.03  # along a self-motion
    walk: int = 60  # most steps from one solution to another
    # share of the way ahead that a step has to be able to go
    stuck: float = 0.05
    same: float = 1e-2  # solutions that are closer are of one family
    rounds: int = 6  # pairs of members between two families that are walked


FAMILIES = FamilySettings()


def representatives(newton: Newton, ways: Ways, x: Array) -> Ways:
    """Of solutions of targets (n,) the most central one of each connected family.

    Each slides as far towards the middle of the ranges as it can.  Those that arrive at one place
    are of one family; of two families the nearest members are walked between, pair after pair.
    """
    u = ways.u
    goals = x[ways.target]
    middle = np.full_like(u, 0.5)
    stand = settle(newton, u, goals, middle, FAMILIES.step)
    met = newton.met(stand.miss)
    central = np.where(met[:, None], stand.u, u)
    a, b = _pairs(ways.target)
    same = newton.away(central[a], central[b]) < FAMILIES.same
    label = _labels(len(u), a[same], b[same])
    order = np.argsort(newton.away(u[a], u[b]), kind="stable")
    a = a[order]
    b = b[order]
    for _ in range(FAMILIES.rounds):
        apart = label[a] != label[b]
        a = a[apart]
        b = b[apart]
        both = np.sort([label[a], label[b]], axis=0)
        nearest = np.unique(both, axis=1, return_index=True)[1]
        if not len(nearest):
            break
        start = a[nearest]
        goal = b[nearest]
        arrived = _arrives(newton, u[start], u[goal], goals[start])
        one = label[start[arrived]]
        other = label[goal[arrived]]
        label = _labels(len(u), one, other)[label]
        a = np.delete(a, nearest)
        b = np.delete(b, nearest)
    members = Ways(ways.target, central, stand.miss)
    order = members.by_middle(newton.scale)
    first = np.unique(label[order], return_index=True)[1]
    return members.rows(order[np.sort(first)])


def _pairs(target: Index) -> tuple[Index, Index]:
    """Pairs of solutions (n,) of one target."""
    edges = np.searchsorted(target, np.unique(target)).tolist()
    parts = [np.zeros((2, 0), dtype=np.intp)]
    for first, last in itertools.pairwise([*edges, len(target)]):
        parts.append(first + np.array(np.tril_indices(last - first, -1)))
    later, earlier = np.concatenate(parts, axis=1)
    return later, earlier


def _labels(count: int, a: Index, b: Index) -> Index:
    """Number (n,) of the connected part in which each of n things is that pairs join."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph.tocsr())[1], dtype=np.intp)


def _arrives(newton: Newton, start: Array, goal: Array, x: Array) -> Mask:
    """Whether steps along the self-motion lead from `start` to `goal`, (n,)."""
    arrived = np.zeros(len(start), dtype=bool)
    rows = np.arange(len(start))
    stand = newton.at(start, x)
    for _ in range(FAMILIES.walk):
        here = stand.rows(rows)
        wish = newton.scale.difference(goal[rows], here.u)
        ahead = lengths(wish)
        move = newton.tangent(here, wish)
        step = shortened(move, FAMILIES.step)
        trial = newton.refine(here.u + step, here.x, SEARCH.close)
        stand.put(rows, trial)
        going = newton.met(trial.miss)
        going &= lengths(move) > FAMILIES.stuck * ahead
        going &= newton.away(trial.u, here.u) < 2 * FAMILIES.step
        left = newton.away(trial.u, goal[rows])
        going &= left < ahead
        near = going & (left < 0.3 * FAMILIES.step)
        arrived[rows[near]] = True
        rows = rows[going & ~near]
        if not len(rows):
            break
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
