"""Poses: every branch in which an arm reaches a position and an orientation.

A general six-joint arm reaches a pose in up to 16 ways; from many starts, damped Newton steps find
them, and each branch that is found suggests where others may be: a joint half a turn on, or bent
the other way.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.scale import TURN, Scale
from .newton import Newton
from .tasks import Evaluate, Poses

#: Random starts of a round, and rounds in a row that must find nothing new.
ROUND, QUIET = 96, 2
_ROUNDS = 12  # at most
_MOST = 64  # branches; more are those of a redundant arm
_STEPS = 25  # most of a start: those that lead anywhere take fewer
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
        away = np.where(turns, np.round((q - self.middle) / TURN), 0.0)
        out = q - TURN * away
        near = (out >= self.lower - _SLACK) & (out <= self.upper + _SLACK)
        return np.clip(out, self.lower, self.upper), np.asarray(near.all(axis=1))

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Joint values (n, dof) drawn from the ranges."""
        return rng.uniform(self.lower, self.upper, (n, len(self.lower)))

    @property
    def turning(self) -> Scale:
        """The unit box of joints that turn without limits: a branch beyond leads to others."""
        turns = np.asarray(self.revolute)
        span = self.upper - self.lower
        lower = np.where(turns, self.middle - np.pi, self.lower - span)
        return Scale(lower, np.where(turns, TURN, 3 * span), turns)

    def apart(self, a: Array, b: Array) -> Array:
        """Largest distance (n,) of any joint between rows (n, dof) and b (dof,); turns wrap."""
        away = a - b
        whole = TURN * np.round(away / TURN)
        return np.asarray(np.abs(away - np.where(self.revolute, whole, 0.0)).max(axis=1))


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
    scale, target = joints.turning, Poses.target(position, rotation)
    newton = Newton(Poses(evaluate, scale, length), scale, length)
    searches = [
        _Search(joints, seed, None if starts is None else starts[i]) for i in range(len(position))
    ]
    open_ = list(range(len(searches)))
    for _ in range(_ROUNDS):
        for part in (open_[i : i + _TOGETHER] for i in range(0, len(open_), _TOGETHER)):
            counts = [len(searches[i].tried) for i in part]
            owner = np.repeat(part, counts)
            tried = scale.to_unit(np.concatenate([searches[i].tried for i in part]))
            u, distance = newton.refine(tried, target[owner], 1e-3 * TOLERANCE, _STEPS)
            q = scale.from_unit(u)
            for i in part:
                own = owner == i
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
