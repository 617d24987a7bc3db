"""Search: of all joints that do a task the nearest to some, or every one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..common.arrays import Array, Index
from ..common.scale import Scale
from .closest import closest
from .families import representatives
from .newton import Newton, Stand
from .settings import SEARCH
from .ways import Ways, distinct

_FURTHER = 1e3
"""What is missed ranks behind whatever is met."""


class Starts(Protocol):
    """Where ways to targets may begin."""

    def of(self, x: Array) -> tuple[Index, Array]:
        """Joints (k, dof) of the unit box, and which of targets (n, m) each is for, ascending."""
        ...


@dataclass(frozen=True)
class Search:
    """One search for every task: starts, Newton steps, and what lies across a fold."""

    newton: Newton
    starts: Starts
    sure: float  # so near to what was asked no other way is nearer
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

    @property
    def scale(self) -> Scale:
        """Range of the joints."""
        return self.newton.scale

    def solve(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) for targets `x` (n, m) nearest to `near` (n, dof), what is missing (n,).

        Joints are in the unit box; out of reach they are those of the nearest attainable point.
        """
        stand = self.nearest(x, near)
        u = stand.u
        miss = stand.miss
        lost = np.flatnonzero(~self.newton.met(miss))
        if len(lost):
            u[lost], miss[lost] = closest(self.newton, u[lost], x[lost])
        return u, miss

    def solve_all(self, x: Array) -> Ways:
        """Every distinct solution of targets (n, m).

        Sorted by target, the one nearest to the middle of the unit box first.  Of redundant joints
        each connected family has one; out of reach there is one, the nearest attainable point.
        """
        ways = self.every(x)
        if self.redundant:
            ways = representatives(self.newton, ways, x)
        lost = np.setdiff1d(np.arange(len(x)), ways.target)
        if not len(lost):
            return ways
        middle = np.full((len(lost), ways.u.shape[1]), 0.5)
        u, miss = self.solve(x[lost], middle)
        return ways.joined(Ways(lost, u, miss), self.scale)

    def nearest(self, x: Array, near: Array) -> Stand:
        """Joints nearest to `near` (n, dof) for targets `x`, or what comes close to them."""
        newton = self.newton
        if self.sure < SEARCH.surely:
            best = newton.at(near, x)
            rank = self._rank(best, near)
            close = SEARCH.rough * newton.task.size
            rows = np.flatnonzero(best.miss <= close)
            self._improve(best, rank, near, rows, near[rows])
        else:
            best = newton.settle(near, x, near)
            rank = self._rank(best, near)
        rows = np.flatnonzero(rank > self.sure)
        if len(rows):
            owner, start = self.starts.of(x[rows])
            owner = rows[owner]
            away = newton.away(start, near[owner])
            first = rank.copy()
            np.minimum.at(first, owner, away + 2 * SEARCH.margin)
            likely = away <= first[owner] + SEARCH.margin
            self._improve(best, rank, near, owner[likely], start[likely])
            others = ~likely & (rank[owner] >= _FURTHER)
            self._improve(best, rank, near, owner[others], start[others])
        rows = np.flatnonzero(rank >= _FURTHER)
        if len(rows):
            owner, start = _drawn(rows, near.shape[1])
            self._improve(best, rank, near, owner, start)
        rows = np.flatnonzero(rank > SEARCH.beside)
        if len(rows) and not newton.redundant:
            row, start = twins(newton, best.rows(rows), self.folded)
            row = rows[row]
            away = newton.away(start, near[row])
            likely = away <= rank[row] + SEARCH.margin
            self._improve(best, rank, near, row[likely], start[likely])
        return best

    def every(self, x: Array) -> Ways:
        """Every way to targets (n, m), sorted as those of `solve_all`.

        Of redundant joints these are some of infinitely many.
        """
        newton = self.newton
        target, start = self.starts.of(x)
        if newton.redundant:
            owner, drawn = _drawn(np.arange(len(x)), start.shape[1])
            target = np.concatenate([target, owner])
            start = np.concatenate([start, drawn])
        stand = newton.refine(start, x[target])
        row = target[:0]
        across = stand.u[:0]
        if not newton.redundant:  # where branches meet
            row, across = twins(newton, stand, SEARCH.folded)
        other = newton.refine(across, stand.x[row])
        ways = Ways(target, stand.u, stand.miss)
        others = Ways(target[row], other.u, other.miss)
        ways = ways.joined(others, self.scale)
        ways = ways.rows(newton.met(ways.miss))
        single = distinct(self.scale, ways.target, ways.u, SEARCH.same)
        return ways.rows(single)

    def _rank(self, stand: Stand, near: Array) -> Array:
        """How bad answers are, (n,): how far from `near` if they are met, else by the miss."""
        away = self.newton.away(stand.u, near)
        behind = _FURTHER + stand.miss / self.newton.task.size
        return np.where(self.newton.met(stand.miss), away, behind)

    def _improve(
        self, best: Stand, rank: Array, near: Array, owner: Index, start: Array
    ) -> None:
        """Put what starts (k, dof) of targets (k,) lead to in the place of what ranks behind it."""
        if not len(owner):
            return
        trial = self.newton.settle(start, best.x[owner], near[owner])
        trial_rank = self._rank(trial, near[owner])
        before = rank[owner]
        np.minimum.at(rank, owner, trial_rank)
        better = (trial_rank < before) & (trial_rank == rank[owner])
        best.put(owner[better], trial.rows(better))


def _drawn(rows: Index, dof: int) -> tuple[Index, Array]:
    """For each row joints (k, dof) at random all over their ranges, many at a limit."""
    u = np.random.default_rng(0).random((SEARCH.drawn, dof))
    u = np.clip(u + SEARCH.aside * (2.0 * u - 1.0), 0.0, 1.0)
    return np.repeat(rows, SEARCH.drawn), np.tile(u, (len(rows), 1))


def twins(newton: Newton, stand: Stand, folded: float) -> tuple[Index, Array]:
    """Rows (m,) near a fold, and starts (m, dof) for the ways across it.

    At a fold, where the Jacobian loses a direction, two ways meet.  Along the direction that hardly
    moves the tip its least singular value falls linearly to zero, and the other way lies about as
    far beyond as this one lies before.
    """
    sides, size, directions = np.linalg.svd(stand.slope, full_matrices=False)
    flattest = size[:, -1] ** 2 <= folded * (size * size).sum(axis=1)
    rows = np.flatnonzero(flattest)
    if not len(rows):
        return rows, stand.u[rows]
    here = stand.rows(rows)
    side = sides[rows, :, -1]
    flat = directions[rows, -1]
    ahead = newton.task.residual(here.u + SEARCH.probe * flat, here.x)[1]
    change = side[:, None] @ (ahead - here.slope) @ flat[:, :, None]
    rate = change[:, 0, 0] / SEARCH.probe
    reach = -2.0 * size[rows, -1] / np.where(rate == 0.0, np.inf, rate)
    near = (np.abs(reach) < SEARCH.beyond) & (reach != 0.0)
    across = here.u[near] + reach[near, None] * flat[near]
    return rows[near], newton.clip(across)
