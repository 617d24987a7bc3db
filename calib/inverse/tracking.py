"""Tracking: joints that stay on one branch while their target moves."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .newton import CLOSE
from .solver import Solver

_INNER = 0.01  # of the extent: a target moves by no more at a time
_FAR = 3.0  # extents of the workspace
_SMOOTH = 0.05  # of the joints' range: joints that move by more are looked at closely
_CLOSELY = 16  # parts of a step that is looked at closely
# of the workspace, and of its nodes' spacing: targets further away from all nodes are not followed
_BEYOND, _SPACINGS = 0.1, 1.5
_FRONT = 8  # solutions of redundant joints that set out together
_FEW = 20  # iterations of a small step: more are of a target out of reach, which creeps
_DRIFT = 0.5  # redundant joints drift to the middle by at most this share of their move


class Track(NamedTuple):
    """Joints that follow a target."""

    u: Array  # (k, dof), joints in the unit box, one row per target
    jumps: list[int]  # rows that joints reach only by leaving their branch after the row before
    # (k,), rows too far from all that the arm reaches to be followed: joints stay where they were
    held: NDArray[np.bool_]


def follow_targets(solver: Solver, x: Array, start: Array | None) -> Track:
    """Follow the targets `x` (k, m), in order, with as few jumps as possible.

    Every solution of the first target sets out, of redundant joints the `_FRONT` nearest to their
    middle, or the one nearest to `start` (dof,); the one that gets furthest without a jump is
    taken, of several the one that moves least. Where it ends the solutions of the next target set
    out, and so on: no other choice of branches jumps less often. Where a target is out of reach,
    joints stay as close to it as they can, which is no jump; where it is further away than
    `_BEYOND` they stay where they are.
    """
    sensory = solver.association.sensory
    away = sensory.nearest(sensory.scale.to_unit(x))[0][:, 0]
    close = away <= max(_BEYOND, _SPACINGS * sensory.spacing)
    if not close.any():  # the first alone: nothing more is told by the others
        wish = np.full((1, solver.scale.span.size), 0.5) if start is None else start[None]
        held = np.arange(len(x)) > 0
        return Track(np.repeat(solver.solve(x[:1], wish)[0], len(x), axis=0), [], held)
    if not close.all():
        near = np.flatnonzero(close)
        track = follow_targets(solver, x[near], start)
        last = np.maximum(np.searchsorted(near, np.arange(len(x)), side="right") - 1, 0)
        return Track(track.u[last], near[track.jumps].tolist(), ~close)
    front = _everywhere(solver, x[0]) if start is None else solver.solve(x[:1], start[None])[0]

    @cache
    def reachable() -> NDArray[np.bool_]:
        return _reachable(solver, x)

    def within(first: int, k: int) -> bool:
        return bool(reachable()[first + k])

    rows: list[Array] = []
    jumps: list[int] = []
    while True:
        best = _furthest(solver, x[len(rows) :], partial(within, len(rows)), front)
        rows += list(best)
        if len(rows) == len(x):
            return Track(np.array(rows), jumps, ~close)
        jumps.append(len(rows))
        front = _everywhere(solver, x[len(rows)])
        # of branches that are as good the closest one: the first counts
        gap = np.linalg.norm(solver.scale.difference(front, rows[-1]), axis=1)
        front = front[np.argsort(gap, kind="stable")]


def _everywhere(solver: Solver, x: Array) -> Array:
    """Solutions of one target, of redundant joints some of each family, (n, dof)."""
    if not solver.redundant:
        return solver.solve_all(x[None])[1]
    families, more = solver.solve_all(x[None])[1], solver.solutions(x[None])[1]
    return np.concatenate([families, more])[:_FRONT]


def _reachable(solver: Solver, x: Array) -> NDArray[np.bool_]:
    """Whether the links lead to joints that meet each target, (n,)."""
    start, _, _ = solver.starts.of(x)
    row, column = np.nonzero(~np.isnan(start[..., 0]))
    distance = solver.newton.refine(start[row, column], x[row], CLOSE)[1]
    met = np.zeros(len(x), dtype=bool)
    met[row[distance <= CLOSE * solver.extent]] = True
    return met


def _furthest(solver: Solver, x: Array, reachable: Callable[[int], bool], front: Array) -> Array:
    """Rows of the joints that follow the targets furthest, (at most k, dof)."""
    history = [front]
    length = np.zeros(len(front))
    alive = np.arange(len(front))
    for k in range(1, len(x)):
        u = history[-1][alive]
        moved, going = _advance(solver, u, x[k - 1], x[k], partial(reachable, k))
        if not going.any():
            break
        rows = history[-1].copy()
        rows[alive] = moved
        gap = np.linalg.norm(solver.scale.difference(moved, u), axis=1)
        length[alive] += gap
        alive = alive[going]
        history.append(rows)
    best = alive[np.argmin(length[alive].round(6))]
    return np.array([rows[best] for rows in history])


def _advance(
    solver: Solver, u: Array, x: Array, goal: Array, reachable: Callable[[], bool]
) -> tuple[Array, NDArray[np.bool_]]:
    """Joints (n, dof) moved along with the target, and whether they kept their branch."""
    shares = _shares(float(np.linalg.norm(goal - x)) / solver.extent)
    going = np.ones(len(u), dtype=bool)
    for begin, end in itertools.pairwise(shares):
        here, there = x + (goal - x) * begin, x + (goal - x) * end
        trial, smooth, met = _step(solver, u, there)
        closely = np.flatnonzero(~smooth)
        if len(closely) and reachable():  # else joints are as close as they can be
            v, kept = u[closely], np.ones(len(closely), dtype=bool)
            for share in np.arange(1, _CLOSELY + 1) / _CLOSELY:
                v, smooth, met[closely] = _step(solver, v, here + (there - here) * share)
                kept &= smooth
            trial[closely] = v
            going[closely] &= kept
        u = trial
    if not met.all() and reachable():  # then it has to be met
        going &= met
    return u, going


def _shares(length: float) -> list[float]:
    """Shares of a way of so many extents at which it is looked at, 0 and 1 among them.

    Of a way that leads far out of the workspace only both ends are looked at closely.
    """
    if length <= 2.0 * _FAR:
        parts = max(1, math.ceil(length / _INNER))
        return [k / parts for k in range(parts + 1)]
    parts = math.ceil(_FAR / _INNER)
    ends = [k / parts * (_FAR / length) for k in range(parts + 1)]
    return ends + [1.0 - share for share in reversed(ends)]


def _step(solver: Solver, u: Array, x: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """One small step of the target; whether joints moved by little, and met it, (n,)."""
    newton = solver.newton
    targets = np.broadcast_to(x, (len(u), len(x)))
    trial, distance = newton.refine(u, targets, CLOSE, _FEW)
    moved = np.linalg.norm(newton.scale.difference(trial, u), axis=1)
    met = distance <= CLOSE * solver.extent
    if solver.redundant:
        # redundant joints use what is free to keep away from their limits
        drift = newton.tangent(trial, newton.scale.difference(np.full_like(trial, 0.5), trial))
        most = _DRIFT * moved / np.maximum(np.linalg.norm(drift, axis=1), 1e-300)
        drift *= np.minimum(0.2, most)[:, None]
        slid, after = newton.refine(trial + drift, targets, CLOSE, _FEW)
        near = np.linalg.norm(newton.scale.difference(slid, trial), axis=1) <= moved + 1e-12
        good = met & (after <= CLOSE * solver.extent) & near
        trial = np.where(good[:, None], slid, trial)
    return trial, moved <= _SMOOTH, met
