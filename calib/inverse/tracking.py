"""Tracking: joints that stay on one branch while their target moves."""

from __future__ import annotations

import itertools
import math
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
_DRIFT = 0.5  # redundant joints drift to the middle by at most this share of their move


class Track(NamedTuple):
    """Joints that follow a target."""

    u: Array  # (k, dof), joints in the unit box, one row per target
    jumps: list[int]  # rows that joints reach only by leaving their branch after the row before


def follow_targets(solver: Solver, x: Array, start: Array | None) -> Track:
    """Follow the targets `x` (k, 2), in order, with as few jumps as possible.

    Every solution of the first target sets out, or the one nearest to `start` (dof,); the one that
    gets furthest without a jump is taken, of several the one that moves least. Where it ends every
    solution of the next target sets out, and so on: no other choice of branches jumps less often.
    Where a target is out of reach, joints stay as close to it as they can, which is no jump; where
    it is further away than `_BEYOND` they stay where they are.
    """
    sensory = solver.association.sensory
    away = sensory.nearest(sensory.scale.to_unit(x))[0][:, 0]
    close = away <= max(_BEYOND, _SPACINGS * sensory.spacing)
    if close.any() and not close.all():
        near = np.flatnonzero(close)
        track = follow_targets(solver, x[near], start)
        held = np.maximum(np.searchsorted(near, np.arange(len(x)), side="right") - 1, 0)
        return Track(track.u[held], near[track.jumps].tolist())
    if not close.any():  # the first alone: nothing more is told by the others
        wish = np.full((1, solver.scale.span.size), 0.5) if start is None else start[None]
        return Track(np.repeat(solver.solve(x[:1], wish)[0], len(x), axis=0), [])
    middle = np.full((len(x), solver.scale.span.size), 0.5)
    reachable = solver.solve(x, middle)[1] <= CLOSE * solver.extent
    front = _everywhere(solver, x[0]) if start is None else solver.solve(x[:1], start[None])[0]
    rows: list[Array] = []
    jumps: list[int] = []
    while True:
        first = len(rows)
        best = _furthest(solver, x[first:], reachable[first:], front)
        rows += list(best)
        if len(rows) == len(x):
            return Track(np.array(rows), jumps)
        jumps.append(len(rows))
        front = _everywhere(solver, x[len(rows)])
        # of branches that are as good the closest one: the first counts
        gap = np.linalg.norm(solver.scale.difference(front, rows[-1]), axis=1)
        front = front[np.argsort(gap, kind="stable")]


def _everywhere(solver: Solver, x: Array) -> Array:
    """Solutions of one target, of redundant joints many of each family, (n, dof)."""
    if solver.scale.span.size <= 2:
        return solver.solve_all(x[None])[1]
    return np.concatenate([solver.solve_all(x[None])[1], solver.solutions(x[None])[1]])


def _furthest(solver: Solver, x: Array, reachable: NDArray[np.bool_], front: Array) -> Array:
    """Rows of the joints that follow the targets furthest, (at most k, dof)."""
    history = [front]
    length = np.zeros(len(front))
    alive = np.arange(len(front))
    for k in range(1, len(x)):
        u = history[-1][alive]
        moved, going = _advance(solver, u, x[k - 1], x[k], bool(reachable[k]))
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
    solver: Solver, u: Array, x: Array, goal: Array, reachable: bool
) -> tuple[Array, NDArray[np.bool_]]:
    """Joints (n, dof) moved along with the target, and whether they kept their branch."""
    shares = _shares(float(np.linalg.norm(goal - x)) / solver.extent)
    going = np.ones(len(u), dtype=bool)
    for begin, end in itertools.pairwise(shares):
        here, there = x + (goal - x) * begin, x + (goal - x) * end
        final = end == 1.0
        # only at the end it is known whether the target is within reach
        trial, smooth = _step(solver, u, there, reachable and final)
        closely = np.flatnonzero(~smooth)
        if len(closely):
            v, kept = u[closely], np.ones(len(closely), dtype=bool)
            for share in np.arange(1, _CLOSELY + 1) / _CLOSELY:
                last = reachable and final and share == 1.0
                v, smooth = _step(solver, v, here + (there - here) * share, last)
                kept &= smooth
            trial[closely] = v
            going[closely] &= kept
        u = trial
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


def _step(solver: Solver, u: Array, x: Array, must_meet: bool) -> tuple[Array, NDArray[np.bool_]]:
    """One small step of the target; whether joints moved by little and met it, (n,)."""
    newton = solver.newton
    targets = np.broadcast_to(x, (len(u), len(x)))
    trial, distance = newton.refine(u, targets)
    moved = np.linalg.norm(newton.scale.difference(trial, u), axis=1)
    smooth = moved <= _SMOOTH
    met = distance <= CLOSE * solver.extent
    if must_meet:
        smooth &= met
    if u.shape[1] > 2:
        # redundant joints use what is free to keep away from their limits
        drift = newton.tangent(trial, newton.scale.difference(np.full_like(trial, 0.5), trial))
        most = _DRIFT * moved / np.maximum(np.linalg.norm(drift, axis=1), 1e-300)
        slid, after = newton.refine(trial + np.minimum(0.2, most)[:, None] * drift, targets)
        near = np.linalg.norm(newton.scale.difference(slid, trial), axis=1) <= moved + 1e-12
        good = met & (after <= CLOSE * solver.extent) & near
        trial = np.where(good[:, None], slid, trial)
    return trial, smooth
