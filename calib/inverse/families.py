"""Families: of redundant joints one member of each connected family that reaches a position.

Two solutions are of one family if small steps along the self-motion, on target and inside of the
limits, lead from one to the other: a family is a connected part of the set of all solutions.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.rows import components, row_lengths
from .newton import Newton, limit_length
from .settings import SOLVER
from .slides import solve_near
from .solutions import Solutions, by_middle


@dataclass(frozen=True)
class FamilySettings:
    """How solutions are joined: lengths are shares of the joints' ranges."""

    step: float = 0.03  # along a self-motion
    walk: int = 60  # most steps from one solution to another
    arrived: float = 0.3  # of a step: so near to its goal a walk ends
    same: float = 1e-2  # solutions that are closer share a family
    rounds: int = 6  # pairs of members between two families that are walked


FAMILY = FamilySettings()


def representatives(
    newton: Newton, solutions: Solutions, x: Array
) -> Solutions:
    """Of solutions of targets (n, m) the most central one of each connected family."""
    goals = x[solutions.target]
    central = _slide_to_middle(newton, solutions, goals)
    family = _families(
        newton,
        solutions,
        goals,
        central.u,
    )
    order = by_middle(newton.scale, central.target, central.u)
    _, first = np.unique(family[order], return_index=True)
    first = np.sort(first)
    return central.rows(order[first])


def _slide_to_middle(
    newton: Newton, solutions: Solutions, goals: Array
) -> Solutions:
    """Solutions as far towards the middle of the ranges as they slide."""
    middle = np.full_like(solutions.u, 0.5)
    iterate = solve_near(
        newton,
        solutions.u,
        goals,
        middle,
        FAMILY.step,
    )
    u = iterate.u
    lost = ~newton.is_met(iterate.distance)
    u[lost] = solutions.u[lost]
    return Solutions(solutions.target, u, iterate.distance)


def _families(
    newton: Newton, solutions: Solutions, goals: Array, central: Array
) -> Index:
    """Number (n,) of the family of each solution.

    Those that slid to one place are of one family.  Of two families the nearest members are walked
    between, pair after pair.

    goals : (n, m), the target of each
    central : (n, dof), where each slid to
    """
    u = solutions.u
    count = len(u)
    a, b = _pairs(solutions.target)
    apart = newton.away(central[a], central[b])
    same = apart < FAMILY.same
    family = components(count, a[same], b[same])
    distance = newton.away(u[a], u[b])
    order = np.argsort(distance, kind="stable")
    a = a[order]
    b = b[order]
    for _ in range(FAMILY.rounds):
        separate = family[a] != family[b]
        a = a[separate]
        b = b[separate]
        nearest = _first_of_each_pair(family[a], family[b])
        if not len(nearest):
            break
        start = a[nearest]
        goal = b[nearest]
        arrived = _arrives(
            newton,
            u[start],
            u[goal],
            goals[start],
        )
        start = start[arrived]
        goal = goal[arrived]
        merged = components(count, family[start], family[goal])
        family = merged[family]
        a = np.delete(a, nearest)
        b = np.delete(b, nearest)
    return family


def _first_of_each_pair(a: Index, b: Index) -> Index:
    """Index of the first occurrence of each pair of numbers (n,), in either order."""
    pairs = np.sort([a, b], axis=0)
    _, first = np.unique(pairs, axis=1, return_index=True)
    return first


def _pairs(target: Index) -> tuple[Index, Index]:
    """Pairs of solutions (n,) of one target."""
    begins = np.searchsorted(target, np.unique(target))
    edges = [*begins.tolist(), len(target)]
    parts = [np.zeros((2, 0), dtype=np.intp)]
    for first, last in itertools.pairwise(edges):
        pairs = np.tril_indices(last - first, -1)
        parts.append(first + np.array(pairs))
    later, earlier = np.concatenate(parts, axis=1)
    return later, earlier


def _arrives(newton: Newton, start: Array, goal: Array, x: Array) -> Mask:
    """Whether steps along the self-motion lead from `start` to `goal`, (n,)."""
    arrived = np.zeros(len(start), dtype=bool)
    rows = np.arange(len(start))
    iterate = newton.at(start, x)
    for _ in range(FAMILY.walk):
        here = iterate.rows(rows)
        preferred_move = newton.scale.difference(goal[rows], here.u)
        ahead = row_lengths(preferred_move)
        move = newton.tangent(here, preferred_move)
        u = here.u + limit_length(move, FAMILY.step)
        trial = newton.refine(u, here.x, SOLVER.close)
        iterate.put(rows, trial)
        shift = newton.away(trial.u, here.u)
        rest = newton.away(trial.u, goal[rows])
        going = newton.is_met(trial.distance)
        going &= shift < 2 * FAMILY.step
        going &= rest < ahead
        near = rest < FAMILY.arrived * FAMILY.step
        there = rows[going & near]
        arrived[there] = True
        rows = rows[going & ~near]
        if not len(rows):
            break
    return arrived
