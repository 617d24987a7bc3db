"""Tracking: joints that stay on one branch while their target moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from .newton import capped
from .settings import SEARCH
from .solver import Solver


@dataclass(frozen=True)
class TrackingSettings:
    """How joints follow a target."""

    # of the ranges: joints that move further are looked at closely
    smooth: float = 0.05
    halved: int = 10  # times that a step is halved at most
    # of the workspace, and of its nodes' spacing: targets further away from all nodes are
    # not followed
    beyond: float = 0.1
    spacings: float = 1.5
    front: int = 8  # solutions of redundant joints that set out together
    # iterations of a small step: more are of a target out of reach
    few: int = 20
    # of the way to the middle, and of their move: so far redundant joints drift there
    wish: float = 0.2
    drift: float = 0.5


TRACKING = TrackingSettings()


def follow_targets(
    solver: Solver, x: Array, start: Array | None
) -> tuple[Array, Index, Mask]:
    """Joints (k, dof) that follow targets `x` (k, m) in their order, with as few jumps as possible.

    Also the rows that joints reach only by leaving their branch, and those (k,) too far from all
    that the arm reaches to be followed.

    Every solution of the first target sets out, of redundant joints those nearest to their middle,
    or the one nearest to `start` (dof,); the one that gets furthest is taken, of several the one
    that moves least.  Where it ends the solutions of the next target set out, and so on.  Out of
    reach joints stay as close as they can, which is no jump; far beyond they wait.
    """
    sensory = solver.association.sensory
    away = sensory.nearest(sensory.scale.to_unit(x))[0][:, 0]
    close = away <= max(TRACKING.beyond, TRACKING.spacings * sensory.spacing)
    lost = not close.any()
    close[0] |= lost  # the first alone: nothing more is learned from the others
    near = np.flatnonzero(close)
    if start is None and not lost:
        front = _front(solver, x[near[0]])
    else:
        wish = np.full(solver.scale.span.shape, 0.5) if start is None else start
        front = solver.solve(x[near[:1]], wish[None])[0]
    follower = _Follower(solver, x[near])
    rows = np.empty((0, front.shape[1]))
    jumps: list[int] = []
    while True:
        rows = np.concatenate([rows, follower.furthest(len(rows), front)])
        if len(rows) == len(near):
            break
        jumps.append(len(rows))
        front = _front(solver, x[near[len(rows)]])
        # of branches that are as good the closest one: the first counts
        gap = solver.newton.away(front, rows[-1])
        front = front[np.argsort(gap, kind="stable")]
    last = np.maximum(
        np.searchsorted(near, np.arange(len(x)), side="right") - 1, 0
    )
    return rows[last], near[np.array(jumps, dtype=np.intp)], ~close


def _front(solver: Solver, x: Array) -> Array:
    """Solutions of one target, of redundant joints some of each family, (n, dof)."""
    families = solver.solve_all(x[None])[1]
    if not solver.redundant:
        return families
    others = solver.search.every(x[None])[1]
    return np.concatenate([families, others])[: TRACKING.front]


class _Follower:
    """Steps of joints on their branches along the targets (k, m)."""

    def __init__(self, solver: Solver, x: Array) -> None:
        self._solver = solver
        self._newton = solver.newton
        self._x = x
        self._reachable: dict[int, bool] = {}

    def furthest(self, first: int, front: Array) -> Array:
        """Rows of the joints that follow the targets from `first` on furthest, (at most k, dof)."""
        history = [front]
        length = np.zeros(len(front))
        alive = np.arange(len(front))
        for k in range(first + 1, len(self._x)):
            u = history[-1][alive]
            moved, going = self._advance(
                u, self._x[k - 1], self._x[k], k, depth=0
            )
            if not going.any():
                break
            rows = history[-1].copy()
            rows[alive] = moved
            length[alive] += self._newton.away(moved, u)
            alive = alive[going]
            history.append(rows)
        best = alive[np.argmin(length[alive].round(6))]
        return np.array([rows[best] for rows in history])

    def _advance(
        self, u: Array, begin: Array, end: Array, row: int, depth: int
    ) -> tuple[Array, Mask]:
        """Joints (n, dof) moved along a line, in halves if far, and whether they kept to it."""
        trial, met = self._step(u, end)
        going = self._newton.away(trial, u) <= TRACKING.smooth
        if (end == self._x[row]).all():  # on the way there they may miss
            going &= met
        again = np.flatnonzero(~going)
        if len(again) and not self._reaches(row):
            going[:] = True  # joints are as close as they can be
        elif len(again) and depth < TRACKING.halved:
            middle = 0.5 * (begin + end)
            half, first = self._advance(u[again], begin, middle, row, depth + 1)
            trial[again], second = self._advance(
                half, middle, end, row, depth + 1
            )
            going[again] = first & second
        return trial, going

    def _reaches(self, row: int) -> bool:
        """Whether the links lead to joints that meet the target of a row."""
        if row not in self._reachable:
            x = self._x[row : row + 1]
            owner, start = self._solver.search.starts.of(x)
            miss = self._newton.refine(start, x[owner], SEARCH.close)[1]
            self._reachable[row] = bool(self._newton.met(miss).any())
        return self._reachable[row]

    def _step(self, u: Array, x: Array) -> tuple[Array, Mask]:
        """Joints (n, dof) after one step of the target, and whether they meet it (n,)."""
        newton = self._newton
        targets = np.tile(x, (len(u), 1))
        met = np.zeros(len(u), dtype=bool)
        trial = u.copy()
        rest = np.arange(len(u))
        if newton.redundant:
            trial, miss = newton.refine(
                u + self._drift(u, targets), targets, SEARCH.close, TRACKING.few
            )
            met = newton.met(miss)
            rest = np.flatnonzero(newton.away(trial, u) > TRACKING.smooth)
        if len(rest):
            trial[rest], miss = newton.refine(
                u[rest], targets[rest], SEARCH.close, TRACKING.few
            )
            met[rest] = newton.met(miss)
        return trial, met

    def _drift(self, u: Array, targets: Array) -> Array:
        """A step (n, dof) of redundant joints to targets, and away from their limits."""
        newton = self._newton
        gap, slope = newton.task.residual(u, targets)
        step = newton.move(u, gap, slope, np.full(len(u), SEARCH.easy))
        step = capped(step, SEARCH.longest)
        free = newton.tangent(
            u, targets, newton.scale.difference(0.5 + 0.0 * u, u)
        )
        longest = TRACKING.drift * np.linalg.norm(step, axis=1)
        share = longest / np.maximum(np.linalg.norm(free, axis=1), 1e-300)
        return np.asarray(
            step + free * np.minimum(TRACKING.wish, share)[:, None]
        )
