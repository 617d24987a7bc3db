"""Solver: the joints nearest to some that meet a target, or all that meet it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..common.arrays import Array, Index
from .families import representatives
from .newton import Iterate, Newton
from .settings import SOLVER
from .slides import solve_near
from .solutions import Solutions, distinct, random_joints

_UNMET = 1e3
"""Cost from which on joints miss their target: above any distance between joints."""


class Starts(Protocol):
    """Joints from which searches for targets start."""

    def of(self, x: Array) -> tuple[Index, Array]:
        """Joints (k, dof) of the unit box, and which of targets (n, m) each is for, ascending."""
        ...


@dataclass(frozen=True)
class BestSolutions:
    """For each of n targets the best solution so far: the nearest to some joints.

    Its arrays are changed in place.
    """

    newton: Newton
    # (n, dof), joints of the unit box that answers should be near to
    near: Array
    iterate: Iterate
    # (n,), how far the joints are from `near`; above `_UNMET` where they miss the target
    cost: Array

    def rows_beyond(self, distance: float) -> Index:
        """Targets whose joints are further from `near` than that, or miss them.

        Those that no solution has met are beyond `_UNMET`.
        """
        return (self.cost >= distance).nonzero()[0]

    def try_likely(self, owner: Index, start: Array) -> None:
        """Try those starts (k, dof) of targets (k,) that may lead to nearer solutions."""
        if not len(owner):
            return
        away = self.newton.away(start, self.near[owner])
        furthest = self.cost.copy()
        np.minimum.at(furthest, owner, away + 2 * SOLVER.margin)
        likely = away <= furthest[owner] + SOLVER.margin
        self.try_starts(owner[likely], start[likely])

    def try_starts(self, owner: Index, start: Array) -> None:
        """Lead starts (k, dof) to targets (k,) and take the solutions that are better."""
        if not len(owner):
            return
        targets = self.iterate.x[owner]
        trial = solve_near(self.newton, start, targets, self.near[owner])
        self.take(owner, trial)

    def take(self, owner: Index, trial: Iterate) -> None:
        """Take solutions (k,) of targets (k,) that are better than the best so far."""
        cost = _cost(self.newton, trial, self.near[owner])
        before = self.cost[owner]
        np.minimum.at(self.cost, owner, cost)
        best = cost == self.cost[owner]
        better = np.flatnonzero(best & (cost < before))
        self.iterate.put(owner[better], trial.rows(better))


def _cost(newton: Newton, iterate: Iterate, near: Array) -> Array:
    """Distance (n,) from `near` of joints that meet their targets; above `_UNMET` of others."""
    met = newton.is_met(iterate.distance)
    away = newton.away(iterate.u, near)
    behind = _UNMET + iterate.distance / newton.task.size
    return np.where(met, away, behind)


@dataclass(frozen=True)
class Solver:
    """One search for every task: starts, Newton steps, and starts across folds."""

    newton: Newton
    starts: Starts
    # whether few starts, and the joints of `near`, are led to a target few_starts
    few_starts: bool = False
    # least singular value of the Jacobian's squares, beside a fold that starts overlook
    fold_threshold: float = SOLVER.fold

    @property
    def extent(self) -> float:
        """Length that residuals are compared with: of positions the workspace's diagonal [unit]."""
        return self.newton.task.size

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than the task has residuals."""
        return self.newton.redundant

    def solve(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) nearest to `near` (n, dof) for targets `x` (n, m), and distances (n,).

        Joints are in the unit box; out of reach they are those of the nearest attainable point.
        """
        iterate = self.nearest(x, near)
        met = self.newton.is_met(iterate.distance)
        lost = (~met).nonzero()[0]
        if len(lost):
            closest = self.newton.closest(iterate.u[lost], x[lost])
            iterate.put(lost, closest)
        return iterate.u, iterate.distance

    def solve_all(self, x: Array) -> Solutions:
        """Every distinct solution of targets (n, m).

        Sorted by target, the one nearest to the middle of the unit box first.  Of redundant joints
        each connected family has one; out of reach there is one, the nearest attainable point.
        """
        solutions = self.every(x)
        if self.redundant:
            solutions = representatives(self.newton, solutions, x)
        targets = np.arange(len(x))
        lost = np.setdiff1d(targets, solutions.target)
        if not len(lost):
            return solutions
        middle = np.full((len(lost), solutions.u.shape[1]), 0.5)
        u, distance = self.solve(x[lost], middle)
        others = Solutions(lost, u, distance)
        return solutions.joined(others, self.newton.scale)

    def nearest(self, x: Array, near: Array) -> Iterate:
        """Joints nearest to `near` (n, dof) for targets `x`, or what comes close to them."""
        newton = self.newton
        if self.few_starts:
            best = self._try_all_at_once(x, near)
        else:
            iterate = solve_near(newton, near, x, near)
            cost = _cost(newton, iterate, near)
            best = BestSolutions(
                newton,
                near,
                iterate,
                cost,
            )
            rows = best.rows_beyond(SOLVER.near_enough_spare)
            if len(rows):
                target, start = self.starts.of(x[rows])
                best.try_likely(rows[target], start)
        rows = best.rows_beyond(_UNMET)
        if len(rows):
            target, start = self._starts_everywhere(x[rows])
            best.try_starts(rows[target], start)
        rows = best.rows_beyond(SOLVER.near_enough)
        if len(rows) and not self.redundant:
            rows, start = starts_across_fold(
                newton,
                best.iterate,
                rows,
                self.fold_threshold,
            )
            best.try_likely(rows, start)
        return best.iterate

    def _try_all_at_once(self, x: Array, near: Array) -> BestSolutions:
        """Lead all starts to targets, with the joints of `near` where they are close."""
        newton = self.newton
        count = len(x)
        targets = np.arange(count)
        target, start = self.starts.of(x)
        # the last of the starts first: of solutions as near the first one counts
        owner = np.concatenate([targets, target[::-1]])
        u = np.concatenate([near, start[::-1]])
        iterate = newton.at(u, x[owner])
        hopeful = iterate.distance <= SOLVER.rough * newton.task.size
        hopeful[count:] = True
        newton.descend(iterate, hopeful)
        cost = _cost(newton, iterate, near[owner])
        order = np.lexsort((cost, owner))
        first = owner[order].searchsorted(targets)
        best = order[first]
        return BestSolutions(
            newton,
            near,
            iterate.rows(best),
            cost[best],
        )

    def every(self, x: Array) -> Solutions:
        """Every solution of targets (n, m), sorted as those of `solve_all`.

        Of redundant joints these are some of infinitely many.
        """
        newton = self.newton
        if newton.redundant:
            target, start = self._starts_everywhere(x)
        else:
            target, start = self.starts.of(x)
        iterate = newton.refine(start, x[target])
        solutions = Solutions(target, iterate.u, iterate.distance)
        if newton.redundant:
            solutions = solutions.sorted(newton.scale)
        else:  # where branches meet
            rows, across = starts_across_fold(
                newton,
                iterate,
                np.arange(len(target)),
                SOLVER.fold,
            )
            other = newton.refine(across, iterate.x[rows])
            others = Solutions(target[rows], other.u, other.distance)
            solutions = solutions.joined(others, newton.scale)
        met = newton.is_met(solutions.distance)
        solutions = solutions.rows(met)
        single = distinct(
            newton.scale,
            solutions.target,
            solutions.u,
            SOLVER.same,
        )
        return solutions.rows(single)

    def _starts_everywhere(self, x: Array) -> tuple[Index, Array]:
        """All starts of targets (n, m), and joints at random all over their ranges."""
        target, start = self.starts.of(x)
        anywhere = random_joints(SOLVER.drawn, start.shape[1])
        owner = np.repeat(np.arange(len(x)), len(anywhere))
        targets = np.concatenate([target, owner])
        joints = np.concatenate([start, np.tile(anywhere, (len(x), 1))])
        return targets, joints


def starts_across_fold(
    newton: Newton, iterate: Iterate, rows: Index, fold_threshold: float
) -> tuple[Index, Array]:
    """Which of some rows are near a fold (k,), and starts (k, dof) for the solutions across it.

    Along the direction v that hardly moves the tip the least singular value s = w' J v falls
    linearly to zero, at a rate ``w' (dJ/dv) v``, and the other solution lies about as far beyond as
    this one lies before.

    fold_threshold : least singular value beside a fold, of the Jacobian's squares
    """
    slope = iterate.slope[rows]
    squares = np.linalg.eigvalsh(slope.swapaxes(1, 2) @ slope)
    folds = squares[:, 0] <= fold_threshold * squares.sum(axis=1)
    rows = rows[folds]
    if not len(rows):
        return rows, iterate.u[rows]
    here = iterate.rows(rows)
    sides, size, directions = np.linalg.svd(here.slope, full_matrices=False)
    flat = directions[:, -1].copy()
    side = sides[:, :, -1]
    probe = here.u + SOLVER.probe * flat
    _, ahead = newton.task.residual(probe, here.x)
    change = (ahead - here.slope) / SOLVER.probe
    rate = np.einsum("nm,nmk,nk->n", side, change, flat)
    rate[rate == 0.0] = np.inf
    reach = -2.0 * size[:, -1] / rate
    near = np.abs(reach) < SOLVER.twin_reach
    shift = reach[near, None] * flat[near]
    across = here.u[near] + shift
    return rows[near], newton.clip(across)
