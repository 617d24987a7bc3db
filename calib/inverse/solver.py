"""Solver: of all joints that do a task the nearest to some, or every one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..common.arrays import Array, Index
from .families import representatives
from .newton import Newton, Stand
from .settings import SOLVER
from .slides import settle
from .ways import Ways, distinct, drawn_joints

_UNMET = 1e3
"""What is missed ranks behind whatever is met."""


class Starts(Protocol):
    """Where ways to targets may begin."""

    def of(self, x: Array) -> tuple[Index, Array]:
        """Joints (k, dof) of the unit box, and which of targets (n, m) each is for, ascending."""
        ...


@dataclass(frozen=True)
class Nearest:
    """For each of n targets the best way so far: the nearest to some joints.

    Its arrays are changed in place.
    """

    newton: Newton
    # (n, dof), joints of the unit box that answers should be near to
    near: Array
    stand: Stand
    # (n,), how far the joints are from `near`; more than any distance where they miss the target
    cost: Array

    @staticmethod
    def of(newton: Newton, stand: Stand, near: Array) -> Nearest:
        """Start with one way to each target."""
        cost = _cost(newton, stand, near)
        return Nearest(
            newton,
            near,
            stand,
            cost,
        )

    def rows_beyond(self, distance: float) -> Index:
        """Targets whose joints are further from `near` than that, or miss them.

        Those that no way has met are `_UNMET`.
        """
        return (self.cost >= distance).nonzero()[0]

    def try_likely(self, owner: Index, start: Array) -> None:
        """Try those starts (k, dof) of targets (k,) that may lead to nearer ways."""
        if not len(owner):
            return
        away = self.newton.away(start, self.near[owner])
        furthest = self.cost.copy()
        np.minimum.at(furthest, owner, away + 2 * SOLVER.margin)
        likely = away <= furthest[owner] + SOLVER.margin
        self.try_starts(owner[likely], start[likely])

    def try_starts(self, owner: Index, start: Array) -> None:
        """Lead starts (k, dof) to targets (k,) and take the ways that are better."""
        if not len(owner):
            return
        targets = self.stand.x[owner]
        trial = settle(self.newton, start, targets, self.near[owner])
        self.take(owner, trial)

    def take(self, owner: Index, trial: Stand) -> None:
        """Take ways (k,) to targets (k,) that are better than the best so far."""
        cost = _cost(self.newton, trial, self.near[owner])
        before = self.cost[owner]
        np.minimum.at(self.cost, owner, cost)
        best = cost == self.cost[owner]
        better = np.flatnonzero(best & (cost < before))
        self.stand.put(owner[better], trial.rows(better))


def _cost(newton: Newton, stand: Stand, near: Array) -> Array:
    """How bad answers are, (n,): how far from `near` if they are met, else by the miss."""
    met = newton.is_met(stand.miss)
    away = newton.away(stand.u, near)
    behind = _UNMET + stand.miss / newton.task.size
    return np.where(met, away, behind)


@dataclass(frozen=True)
class Solver:
    """One search for every task: starts, Newton steps, and what lies across a fold."""

    newton: Newton
    starts: Starts
    # whether few starts, and the joints of `near`, are led to a target together
    together: bool = False
    # least singular value of the Jacobian's squares, beside a fold that starts overlook
    folded: float = SOLVER.fold

    @property
    def extent(self) -> float:
        """A length that misses are compared with: of positions the workspace's diagonal [unit]."""
        return self.newton.task.size

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than the task has residuals."""
        return self.newton.redundant

    def solve(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) for targets `x` (n, m) nearest to `near` (n, dof), what is missing (n,).

        Joints are in the unit box; out of reach they are those of the nearest attainable point.
        """
        stand = self.nearest(x, near)
        met = self.newton.is_met(stand.miss)
        lost = (~met).nonzero()[0]
        if len(lost):
            closest = self.newton.closest(stand.u[lost], x[lost])
            stand.put(lost, closest)
        return stand.u, stand.miss

    def solve_all(self, x: Array) -> Ways:
        """Every distinct solution of targets (n, m).

        Sorted by target, the one nearest to the middle of the unit box first.  Of redundant joints
        each connected family has one; out of reach there is one, the nearest attainable point.
        """
        ways = self.every(x)
        if self.redundant:
            ways = representatives(self.newton, ways, x)
        targets = np.arange(len(x))
        lost = np.setdiff1d(targets, ways.target)
        if not len(lost):
            return ways
        dof = ways.u.shape[1]
        middle = np.full((len(lost), dof), 0.5)
        u, miss = self.solve(x[lost], middle)
        others = Ways(lost, u, miss)
        return ways.joined(others, self.newton.scale)

    def nearest(self, x: Array, near: Array) -> Stand:
        """Joints nearest to `near` (n, dof) for targets `x`, or what comes close to them."""
        newton = self.newton
        if self.together:
            best = self._try_all_at_once(x, near)
        else:
            stand = settle(newton, near, x, near)
            best = Nearest.of(newton, stand, near)
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
            rows, start = twins(
                newton,
                best.stand,
                rows,
                self.folded,
            )
            best.try_likely(rows, start)
        return best.stand

    def _try_all_at_once(self, x: Array, near: Array) -> Nearest:
        """Lead all starts to targets, with the joints of `near` where they are close."""
        newton = self.newton
        count = len(x)
        targets = np.arange(count)
        target, start = self.starts.of(x)
        # the last of the starts first: of ways as near the first one counts
        owner = np.concatenate([targets, target[::-1]])
        u = np.concatenate([near, start[::-1]])
        stand = newton.at(u, x[owner])
        hopeful = stand.miss <= SOLVER.rough * newton.task.size
        hopeful[count:] = True
        newton.descend(stand, hopeful)
        cost = _cost(newton, stand, near[owner])
        order = np.lexsort((cost, owner))
        first = owner[order].searchsorted(targets)
        best = order[first]
        return Nearest(
            newton,
            near,
            stand.rows(best),
            cost[best],
        )

    def every(self, x: Array) -> Ways:
        """Every way to targets (n, m), sorted as those of `solve_all`.

        Of redundant joints these are some of infinitely many.
        """
        newton = self.newton
        if newton.redundant:
            target, start = self._starts_everywhere(x)
        else:
            target, start = self.starts.of(x)
        stand = newton.refine(start, x[target])
        ways = Ways(target, stand.u, stand.miss)
        if newton.redundant:
            ways = ways.sorted(newton.scale)
        else:  # where branches meet
            rows = np.arange(len(target))
            rows, across = twins(
                newton,
                stand,
                rows,
                SOLVER.fold,
            )
            other = newton.refine(across, stand.x[rows])
            others = Ways(target[rows], other.u, other.miss)
            ways = ways.joined(others, newton.scale)
        met = newton.is_met(ways.miss)
        ways = ways.rows(met)
        single = distinct(
            newton.scale,
            ways.target,
            ways.u,
            SOLVER.same,
        )
        return ways.rows(single)

    def _starts_everywhere(self, x: Array) -> tuple[Index, Array]:
        """All starts of targets (n, m), and joints at random all over their ranges."""
        target, start = self.starts.of(x)
        drawn = drawn_joints(SOLVER.drawn, start.shape[1])
        owner = np.repeat(np.arange(len(x)), len(drawn))
        targets = np.concatenate([target, owner])
        joints = np.concatenate([start, np.tile(drawn, (len(x), 1))])
        return targets, joints


def twins(
    newton: Newton, stand: Stand, rows: Index, folded: float
) -> tuple[Index, Array]:
    """Which of some rows are near a fold (k,), and starts (k, dof) for the ways across it.

    Along the direction v that hardly moves the tip the least singular value s = w' J v falls
    linearly to zero, at a rate ``w' (dJ/dv) v``, and the other way lies about as far beyond as this
    one lies before.

    folded : least singular value beside a fold, of the Jacobian's squares
    """
    slope = stand.slope[rows]
    squares = np.linalg.eigvalsh(slope.swapaxes(1, 2) @ slope)
    folds = squares[:, 0] <= folded * squares.sum(axis=1)
    rows = rows[folds]
    if not len(rows):
        return rows, stand.u[rows]
    here = stand.rows(rows)
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
