"""Search: of all joints that do a task the nearest to some, or every one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.scale import Scale
from .closest import closest
from .families import representatives
from .newton import Newton
from .settings import SEARCH
from .ways import by_middle, distinct


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
        u, miss = self.nearest(x, near)
        lost = np.flatnonzero(~self.newton.met(miss))
        if len(lost):
            u[lost], miss[lost] = closest(self.newton, u[lost], x[lost])
        return u, miss

    def solve_all(self, x: Array) -> tuple[Index, Array, Array]:
        """Every distinct solution of targets (n, m): of which it is, joints (k, dof), distance.

        Sorted by target, the one nearest to the middle of the unit box first.  Of redundant joints
        each connected family has one; out of reach there is one, the nearest attainable point.
        """
        target, u, miss = self.every(x)
        if self.redundant and len(u):
            target, u, miss = representatives(self.newton, target, u, x)
        lost = np.setdiff1d(np.arange(len(x)), target)
        if len(lost):
            middle = np.full((len(lost), u.shape[1]), 0.5)
            nearest, missing = self.solve(x[lost], middle)
            target = np.concatenate([target, lost])
            u = np.concatenate([u, nearest])
            miss = np.concatenate([miss, missing])
        return by_middle(self.scale, target, u, miss)

    def nearest(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) nearest to `near` (n, dof) for targets `x`, and what is missing (n,)."""
        newton = self.newton
        u, miss = newton.settle(near, x, near)
        rows = _unsure(newton, u, miss, near, self.sure)
        if len(rows):
            owner, start = self.starts.of(x[rows])
            owner = rows[owner]
            likely = _likely(newton, u, miss, near, owner, start)
            u, miss = _better(
                newton, x, near, u, miss, owner[likely], start[likely]
            )
        if not newton.redundant:
            rows = _unsure(newton, u, miss, near, SEARCH.beside)
            row, across = twins(newton, u[rows], x[rows])
            u, miss = _better(newton, x, near, u, miss, rows[row], across)
        rows = np.flatnonzero(~newton.met(miss))
        start = np.tile(_drawn(u.shape[1]), (len(rows), 1))
        owner = np.repeat(rows, SEARCH.drawn)
        return _better(newton, x, near, u, miss, owner, start)

    def every(self, x: Array) -> tuple[Index, Array, Array]:
        """Every way: of which target (k,), ascending, joints (k, dof), what is missing (k,).

        Of redundant joints these are some of infinitely many.
        """
        newton = self.newton
        target, u = self.starts.of(x)
        u, miss = newton.refine(u, x[target])
        if not newton.redundant:  # where branches meet
            row, start = twins(newton, u, x[target])
            across, missing = newton.refine(start, x[target[row]])
            target = np.append(target, target[row])
            u = np.concatenate([u, across])
            miss = np.append(miss, missing)
        met = newton.met(miss)
        target, u, miss = by_middle(
            newton.scale, target[met], u[met], miss[met]
        )
        single = distinct(newton.scale, target, u, SEARCH.same)
        return target[single], u[single], miss[single]


def _unsure(
    newton: Newton, u: Array, miss: Array, near: Array, sure: float
) -> Index:
    """Targets that are missed, or met further than `sure` from where joints should be."""
    return np.flatnonzero((newton.away(u, near) > sure) | ~newton.met(miss))


def _likely(
    newton: Newton,
    u: Array,
    miss: Array,
    near: Array,
    owner: Index,
    start: Array,
) -> Mask:
    """Which starts (k, dof) may lead to joints that are nearer than the best so far."""
    away = newton.away(start, near[owner])
    best = newton.away(u, near)
    other = newton.away(start, u[owner]) >= 0.5 * SEARCH.margin
    nearer = other & (away <= best[owner] + SEARCH.margin)
    missed = ~newton.met(miss[owner])
    if newton.redundant:  # each slide takes long
        first = np.full(len(u), np.inf)
        np.minimum.at(first, owner, away)
        missed &= away <= first[owner] + SEARCH.surely
    return np.where(newton.met(miss[owner]), nearer, missed)


def _better(
    newton: Newton,
    x: Array,
    near: Array,
    u: Array,
    miss: Array,
    owner: Index,
    start: Array,
) -> tuple[Array, Array]:
    """The best joints (n, dof) of those so far and those that starts (k, dof) lead to, and misses.

    A target that is met goes before one that is missed, then what is near counts.
    """
    if not len(owner):
        return u, miss
    others, missing = newton.settle(start, x[owner], near[owner])
    count = len(u)
    owner = np.concatenate([np.arange(count), owner])
    u = np.concatenate([u, others])
    miss = np.concatenate([miss, missing])
    missed = ~newton.met(miss)
    away = newton.away(u, near[owner])
    order = np.lexsort((np.where(missed, miss, away), missed, owner))
    best = order[np.searchsorted(owner[order], np.arange(count))]
    return u[best], miss[best]


def _drawn(dof: int) -> Array:
    """Joints (n, dof) at random all over their ranges, many at a limit."""
    u = np.random.default_rng(0).random((SEARCH.drawn, dof))
    return np.clip(u + SEARCH.aside * (2.0 * u - 1.0), 0.0, 1.0)


def twins(newton: Newton, u: Array, x: Array) -> tuple[Index, Array]:
    """Rows (m,) of `u` (n, dof) near a fold, and starts (m, dof) for the ways across it.

    At a fold, where the Jacobian loses a direction, two ways meet.  Along the direction that hardly
    moves the tip its least singular value falls linearly to zero, and the other way lies about as
    far beyond as this one lies before.
    """
    slope = newton.task.residual(u, x)[1]
    sides, size, directions = np.linalg.svd(slope, full_matrices=False)
    folded = size[:, -1] ** 2 <= SEARCH.folded * (size * size).sum(axis=1)
    rows = np.flatnonzero(folded)
    side = sides[rows, :, -1]
    flat = directions[rows, -1]
    shift = SEARCH.probe * flat
    ahead = newton.task.residual(u[rows] + shift, x[rows])[1]
    behind = newton.task.residual(u[rows] - shift, x[rows])[1]
    change = (side[:, None] @ (ahead - behind) @ flat[:, :, None])[:, 0, 0]
    rate = change / (2 * SEARCH.probe)
    reach = -2.0 * size[rows, -1] / np.where(rate == 0.0, np.inf, rate)
    near = (np.abs(reach) < SEARCH.beyond) & (reach != 0.0)
    across = u[rows[near]] + reach[near, None] * flat[near]
    return rows[near], newton.clip(across)
