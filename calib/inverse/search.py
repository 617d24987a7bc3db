"""Search: of all joints that do a task the nearest to some, or every one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..common.arrays import Array, Index
from .families import representatives
from .folds import twins
from .newton import Newton, Stand
from .settings import SEARCH
from .slides import settle
from .ways import Ways, distinct, drawn_joints

_FURTHER = 1e3
"""What is missed ranks behind whatever is met."""


class Starts(Protocol):
    """Where ways to targets may begin."""

    def of(self, x: Array) -> tuple[Index, Array]:
        """Joints (k, dof) of the unit box, and which of targets (n, m) each is for, ascending."""
        ...


@dataclass(frozen=True)
class Nearest:
    """For each of n targets the best way so far: the nearest to some joints; changed in place."""

    newton: Newton
    # (n, dof), joints of the unit box that answers should be near to
    near: Array
    stand: Stand
    # (n,), how far the joints are from `near`; more than any distance where they miss the target
    rank: Array

    @staticmethod
    def of(newton: Newton, stand: Stand, near: Array) -> Nearest:
        """Begin with one way to each target."""
        rank = _rank(newton, stand, near)
        return Nearest(newton, near, stand, rank)

    def further(self, distance: float) -> Index:
        """Targets whose joints are further from `near` than that, or miss them.

        Those that no way has met are `_FURTHER`.
        """
        return (self.rank >= distance).nonzero()[0]

    def try_likely(self, owner: Index, start: Array) -> None:
        """Try those starts (k, dof) of targets (k,) that may lead to nearer ways."""
        away = self.newton.away(start, self.near[owner])
        furthest = self.rank.copy()
        np.minimum.at(furthest, owner, away + 2 * SEARCH.margin)
        likely = away <= furthest[owner] + SEARCH.margin
        self.try_starts(owner[likely], start[likely])

    def try_starts(self, owner: Index, start: Array) -> None:
        """Lead starts (k, dof) to targets (k,) and take the ways that are better."""
        if not len(owner):
            return
        near = self.near[owner]
        targets = self.stand.x[owner]
        trial = settle(self.newton, start, targets, near)
        self.take(owner, trial)

    def take(self, owner: Index, trial: Stand) -> None:
        """Take ways (k,) to targets (k,) that are better than the best so far."""
        rank = _rank(self.newton, trial, self.near[owner])
        before = self.rank[owner]
        np.minimum.at(self.rank, owner, rank)
        best = rank == self.rank[owner]
        better = best & (rank < before)
        self.stand.put(owner[better], trial.rows(better))


def _rank(newton: Newton, stand: Stand, near: Array) -> Array:
    """How bad answers are, (n,): how far from `near` if they are met, else by the miss."""
    met = newton.is_met(stand.miss)
    away = newton.away(stand.u, near)
    behind = _FURTHER + stand.miss / newton.task.size
    return np.where(met, away, behind)


@dataclass(frozen=True)
class Search:
    """One search for every task: starts, Newton steps, and what lies across a fold."""

    newton: Newton
    starts: Starts
    # whether few starts, and the joints asked for, are led to a target together
    together: bool = False
    # least singular value of the Jacobian's squares, beside a fold that starts overlook
    folded: float = SEARCH.folded

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
        lost = np.flatnonzero(~met)
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
            rows = best.further(SEARCH.surely)
            if len(rows):
                target, start = self.starts.of(x[rows])
                best.try_likely(rows[target], start)
        rows = best.further(_FURTHER)
        if len(rows):
            target, start = self._starts_everywhere(x[rows])
            best.try_starts(rows[target], start)
        rows = best.further(SEARCH.beside)
        if len(rows) and not self.redundant:
            place, start = twins(newton, best.stand.rows(rows), self.folded)
            best.try_likely(rows[place], start)
        return best.stand

    def _try_all_at_once(self, x: Array, near: Array) -> Nearest:
        """Lead all starts to targets, with the joints asked for where they are close."""
        newton = self.newton
        count = len(x)
        target, start = self.starts.of(x)
        owner = np.concatenate([np.arange(count), target])
        u = np.concatenate([near, start])
        stand = newton.at(u, x[owner])
        hopeful = stand.miss <= SEARCH.rough * newton.task.size
        hopeful[count:] = True
        newton.descend(stand, hopeful)
        first = stand.rows(slice(count))
        best = Nearest.of(newton, first, near)
        others = stand.rows(slice(count, None))
        best.take(target, others)
        return best

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
            place, across = twins(newton, stand, SEARCH.folded)
            other = newton.refine(across, stand.x[place])
            others = Ways(target[place], other.u, other.miss)
            ways = ways.joined(others, self.newton.scale)
        met = newton.is_met(ways.miss)
        ways = ways.rows(met)
        single = distinct(self.newton.scale, ways.target, ways.u, SEARCH.same)
        return ways.rows(single)

    def _starts_everywhere(self, x: Array) -> tuple[Index, Array]:
        """All starts of targets (n, m), and joints at random all over their ranges."""
        target, start = self.starts.of(x)
        drawn = drawn_joints(SEARCH.drawn, start.shape[1])
        owner = np.repeat(np.arange(len(x)), len(drawn))
        targets = np.concatenate([target, owner])
        joints = np.concatenate([start, np.tile(drawn, (len(x), 1))])
        return targets, joints
