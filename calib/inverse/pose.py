"""Poses: joint values for a position and an orientation, with every branch of the arm.

Works on any arm through one function that evaluates it. A general six-joint arm reaches a pose in
up to 16 ways; from many starts, damped Newton steps find them, and each branch that is found
suggests where others may be: a joint half a turn on, or bent the other way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import logarithm
from ..common.arrays import Array, Index
from .newton import damped_solution, damped_steps

#: Position (n, 3) [m], orientation (n, 3, 3) and geometric Jacobian (n, 6, dof) at joints (n, dof).
Evaluate = Callable[[Array], tuple[Array, Array, Array]]

#: Random starts of a round, and rounds in a row that must find nothing new.
ROUND, QUIET = 96, 2
_ROUNDS = 12  # at most
_MOST = 64  # branches; more are those of a redundant arm
_SLACK = 1e-9  # [rad or m] by which a joint may be rounded beyond its range
_TOGETHER = 50  # poses that are searched side by side
#: A pose is reached within this share of the arm's length, and solutions this far apart [rad or m]
#: are different branches.
TOLERANCE, APART = 1e-9, 1e-3


@dataclass(frozen=True)
class Joints:
    """Ranges of joints: `lower`, `upper` (dof,) [rad or m] and which of them turn (dof,)."""

    lower: Array
    upper: Array
    revolute: tuple[bool, ...]

    @property
    def middle(self) -> Array:
        """Middle (dof,) of the ranges."""
        return 0.5 * (self.lower + self.upper)

    def within(self, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Joint values (n, dof) by whole turns into the ranges, and whether all are inside (n,)."""
        turns = np.asarray(self.revolute)
        away = np.where(turns, np.round((q - self.middle) / (2 * np.pi)), 0.0)
        out = q - 2 * np.pi * away
        near = (out >= self.lower - _SLACK) & (out <= self.upper + _SLACK)
        return np.clip(out, self.lower, self.upper), np.asarray(near.all(axis=1))

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Joint values (n, dof) drawn from the ranges."""
        return rng.uniform(self.lower, self.upper, (n, len(self.lower)))

    def apart(self, a: Array, b: Array) -> Array:
        """Largest distance (n,) of any joint between rows (n, dof) and b (dof,); turns wrap."""
        away = a - b
        whole = 2 * np.pi * np.round(away / (2 * np.pi))
        return np.asarray(np.abs(away - np.where(self.revolute, whole, 0.0)).max(axis=1))


@dataclass(frozen=True, eq=False)
class Reached:
    """Joint values that answer one target."""

    q: Array  # (k, dof) [rad or m], the preferred one first
    # (k, 3) and (k, 3, 3) arrays [m], where they put the tip, in the base frame
    position: Array
    rotation: Array
    away: Array  # (k,) [m], distance from the position asked for
    turned: Array  # (k,) [rad], turn from the orientation asked for, 0 where none was
    reachable: bool


def reach_poses(
    evaluate: Evaluate, q: Array, position: Array, rotation: Array, length: float
) -> tuple[Array, Array]:
    """Joints (n, dof) moved from starts `q` towards poses (n, 3), (n, 3, 3) by damped Newton steps.

    Also what is left (n,) [m] of the position and, times `length`, of the orientation: a radian is
    worth the arm's length. Each row is on its own.
    """
    scale = np.r_[np.ones(3), np.full(3, length)][:, None]

    def misfit(q: Array, rows: Index) -> tuple[Array, Array]:
        p, r, jacobian = evaluate(q.T)
        turn = logarithm(rotation[rows] @ np.swapaxes(r, 1, 2))
        gap = np.concatenate([position[rows] - p, length * turn], axis=1)
        return gap.T, np.ascontiguousarray((jacobian * scale).transpose(2, 1, 0))

    def advance(q: Array, slope: Array, gap: Array, damping: Array) -> Array:
        step = damped_solution(slope, gap, damping)
        longest = np.maximum(np.abs(step).max(axis=0), 1e-300)
        return np.asarray(q + step * np.minimum(1.0, 1.0 / longest))

    met = 1e-3 * TOLERANCE * length
    found, distance = damped_steps(misfit, advance, q.T.copy(), met, met)
    return found.T, distance


def taken(better: NDArray[np.bool_], new: Sequence[Array], old: Sequence[Array]) -> list[Array]:
    """Rows of new arrays (n, ...) where they are better (n,), else of the old ones."""
    pairs = zip(new, old, strict=True)
    return [np.where(better.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs]


def pose_branches(
    evaluate: Evaluate,
    position: Array,
    rotation: Array,
    joints: Joints,
    length: float,
    *,
    starts: Array | None = None,
    seed: int = 0,
) -> list[Array]:
    """Every way (b, dof) in which an arm reaches each of some poses (n, 3), (n, 3, 3) [m].

    Joints are within their ranges and reach the pose to 1e-9 of the arm's length; sorted; empty
    where nothing does. Of a redundant arm they are some of infinitely many. `starts` (n, dof) were
    active near each pose and are tried first, then starts that are drawn by `seed`, in at most
    `_ROUNDS` rounds; the search ends when two in a row find nothing new. The poses are searched
    side by side: an evaluation of one row costs as much as one of a hundred.
    """
    searches = [
        _Search(joints, seed, None if starts is None else starts[i]) for i in range(len(position))
    ]
    open_ = list(range(len(searches)))
    for _ in range(_ROUNDS):
        for part in (open_[i : i + _TOGETHER] for i in range(0, len(open_), _TOGETHER)):
            counts = [len(searches[i].tried) for i in part]
            target = np.repeat(part, counts)
            q, distance = reach_poses(
                evaluate,
                np.concatenate([searches[i].tried for i in part]),
                position[target],
                rotation[target],
                length,
            )
            for i in part:
                own = target == i
                searches[i].learn(q[own][distance[own] < TOLERANCE * length])
        open_ = [i for i in open_ if searches[i].going]
        if not open_:
            break
    return [search.inside() for search in searches]


class _Search:
    """Branches of one pose that are known, and where to look for more: `start` (dof,) first."""

    def __init__(self, joints: Joints, seed: int, start: Array | None) -> None:
        self._joints, self._rng = joints, np.random.default_rng(seed)
        self._known = np.empty((0, len(joints.lower)))
        self._inside = np.empty(0, dtype=bool)
        self._quiet = 0
        drawn = joints.draw(ROUND, self._rng)
        self.tried = drawn if start is None else np.vstack([start, drawn])

    @property
    def going(self) -> bool:
        """Whether a round may find more."""
        return self._quiet < QUIET and len(self._known) <= _MOST

    def learn(self, reached: Array) -> None:
        """Take solutions (k, dof) of a round, and choose the starts of the next."""
        fresh = []
        for row, ok in zip(*self._joints.within(reached), strict=True):
            if not len(self._known) or self._joints.apart(self._known, row).min() > APART:
                self._known = np.vstack([self._known, row])
                self._inside = np.append(self._inside, ok)
                fresh.append(row)
        self._quiet = 0 if fresh else self._quiet + 1
        if self.going:
            flipped = (_flipped(row, self._joints) for row in fresh)
            self.tried = np.vstack([*flipped, self._joints.draw(ROUND, self._rng)])

    def inside(self) -> Array:
        """Solutions within the ranges, sorted."""
        found = self._known[self._inside]
        return found[np.lexsort(found.T[::-1])]


def _flipped(q: Array, joints: Joints) -> Array:
    """Starts that a branch suggests: turns half round, or bent the other way, and pairs of them."""
    joint, turns = np.arange(len(q)), np.flatnonzero(joints.revolute)
    rows = [np.where(joint == k, moved, q) for k in turns for moved in (q + np.pi, -q)]
    for i, j in permutations(turns, 2):
        rows.append(np.where(joint == i, q + np.pi, np.where(joint == j, -q, q)))
    return np.array(rows).reshape(-1, len(q))
