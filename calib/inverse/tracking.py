"""Tracking: joints that stay on one branch while their target moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from .settings import SEARCH
from .solver import Solver

_SMOOTH = 0.05  # of the joints' range: joints that move by more are looked at closely
_HALVED = 10  # times that a step is halved at most
# of the workspace, and of its nodes' spacing: targets further away from all nodes are not followed
_BEYOND = 0.1
_SPACINGS = 1.5
_FRONT = 8  # solutions of redundant joints that set out together
_FEW = 20  # iterations of a small step: more are of a target out of reach, which creeps
# of the way to the middle, and of their move: so far joints drift there
_WISHED = 0.2
_DRIFT = 0.5


def follow_targets(
    solver: Solver, x: Array, start: Array | None
) -> tuple[Array, Index, NDArray[np.bool_]]:
    """Joints (k, dof) that follow targets `x` (k, m) in their order, with as few jumps as possible.

    Also the rows that joints reach only by leaving their branch, and those (k,) too far from all
    that the arm reaches to be followed.

    Every solution of the first target sets out, of redundant joints the `_FRONT` nearest to their
    middle, or the one nearest to `start` (dof,); the one that gets furthest is taken, of several
    the one that moves least. Where it ends the solutions of the next target set out, and so on.
    Out of reach joints stay as close as they can, which is no jump; beyond `_BEYOND` they wait.
    """
    sensory = solver.association.sensory
    away = sensory.nearest(sensory.scale.to_unit(x))[0][:, 0]
    close = away <= max(_BEYOND, _SPACINGS * sensory.spacing)
    lost = not close.any()
    close[0] |= lost  # the first alone: nothing more is told by the others
    near = np.flatnonzero(close)
    if start is None and not lost:
        front = _everywhere(solver, x[near[0]])
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
        front = _everywhere(solver, x[near[len(rows)]])
        # of branches that are as good the closest one: the first counts
        gap = np.linalg.norm(solver.scale.difference(front, rows[-1]), axis=1)
        front = front[np.argsort(gap, kind="stable")]
    last = np.maximum(np.searchsorted(near, np.arange(len(x)), side="right") - 1, 0)
    return rows[last], near[np.array(jumps, dtype=np.intp)], ~close


def _everywhere(solver: Solver, x: Array) -> Array:
    """Solutions of one target, of redundant joints some of each family, (n, dof)."""
    families = solver.solve_all(x[None])[1]
    if not solver.redundant:
        return families
    return np.concatenate([families, solver.solutions(x[None])[1]])[:_FRONT]


class _Follower:
    """Steps of joints on their branches along the targets (k, m)."""

    def __init__(self, solver: Solver, x: Array) -> None:
        self._solver = solver
        self._x = x
        self._reached = np.full(len(x), -1)  # not known yet

    def furthest(self, first: int, front: Array) -> Array:
        """Rows of the joints that follow the targets from `first` on furthest, (at most k, dof)."""
        history = [front]
        length = np.zeros(len(front))
        alive = np.arange(len(front))
        for k in range(first + 1, len(self._x)):
            u = history[-1][alive]
            moved, going = self._advance(u, self._x[k - 1 : k + 1], k, _HALVED)
            if not going.any():
                break
            rows = history[-1].copy()
            rows[alive] = moved
            length[alive] += self._moved(moved, u)
            alive = alive[going]
            history.append(rows)
        best = alive[np.argmin(length[alive].round(6))]
        return np.array([rows[best] for rows in history])

    def _advance(
        self, u: Array, way: Array, row: int, halved: int, last: bool = True
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Joints (n, dof) moved along a way (2, m), in halves if far, and if they kept to it."""
        trial, smooth, met = self._step(u, way[1])
        going = smooth & (met | ~np.array(last))
        again = np.flatnonzero(~going)
        if len(again) and not self._reachable(row):
            going[:] = True  # joints are as close as they can be
        elif len(again) and halved:
            middle = way.mean(axis=0)
            half, kept = self._advance(
                u[again], np.stack([way[0], middle]), row, halved - 1, False
            )
            rest = np.stack([middle, way[1]])
            trial[again], going[again] = self._advance(
                half, rest, row, halved - 1, last
            )
            going[again] &= kept
        return trial, going

    def _reachable(self, row: int) -> bool:
        """Whether the links lead to joints that meet the target of a row."""
        if self._reached[row] < 0:
            solver = self._solver
            x = self._x[row : row + 1]
            start, _ = solver.starts.of(x)
            u = start[~np.isnan(start[..., 0])]
            left = solver.newton.refine(u, np.repeat(x, len(u), axis=0), SEARCH.close)[
                1
            ]
            self._reached[row] = (left <= SEARCH.close * solver.extent).any()
        return bool(self._reached[row])

    def _step(
        self, u: Array, x: Array
    ) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """One step of the target; whether joints moved by little, and met it, (n,)."""
        solver = self._solver
        newton = self._solver.newton
        targets = np.broadcast_to(x, (len(u), len(x)))
        met = np.zeros(len(u), dtype=bool)
        trial = u.copy()
        rest = np.arange(len(u))
        if solver.redundant:
            # redundant joints use what is free to keep away from their limits
            step = newton.towards(u, targets, 1e-9)
            free = newton.tangent(u, solver.scale.difference(np.full_like(u, 0.5), u))
            longest = _DRIFT * np.linalg.norm(step, axis=1)
            share = longest / np.maximum(np.linalg.norm(free, axis=1), 1e-300)
            start = u + step + free * np.minimum(_WISHED, share)[:, None]
            trial, distance = newton.refine(start, targets, SEARCH.close, _FEW)
            met = distance <= SEARCH.close * newton.extent
            rest = np.flatnonzero(self._moved(trial, u) > _SMOOTH)
        if len(rest):
            trial[rest], distance = newton.refine(
                u[rest], targets[rest], SEARCH.close, _FEW
            )
            met[rest] = distance <= SEARCH.close * newton.extent
        return trial, self._moved(trial, u) <= _SMOOTH, met

    def _moved(self, u: Array, before: Array) -> Array:
        return np.asarray(
            np.linalg.norm(self._solver.scale.difference(u, before), axis=1)
        )
