"""Branches: every way in which an arm does a pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..common.scale import TURN, Scale
from .newton import Newton
from .settings import SEARCH
from .starts import distinct, twins
from .task import Evaluate, Poses

#: A pose is reached within this share of the arm's length.
TOLERANCE = 1e-9


@dataclass(frozen=True)
class RandomStarts:
    """Starts for arms without a closed form; counted against a UR5's 8 branches."""

    at_once: int = 96  # starts of a round
    quiet: int = 2  # rounds in a row that must find nothing new
    rounds: int = 12  # at most
    most: int = 64  # branches; more are those of a redundant arm
    steps: int = 25  # of a start: those that lead anywhere take fewer
    together: int = 50  # poses side by side: one row costs as much as a hundred


RANDOM = RandomStarts()


@dataclass(frozen=True)
class Joints:
    """Ranges of joints: `lower`, `upper` (dof,) [rad or m] and which of them turn (dof,)."""

    lower: Array
    upper: Array
    revolute: tuple[bool, ...]

    @property
    def scale(self) -> Scale:
        """The unit box of the ranges."""
        return Scale.of_range(self.lower, self.upper, self.revolute)

    @property
    def turning(self) -> Scale:
        """The unit box of joints that turn without limits: a branch beyond leads to others."""
        span = self.upper - self.lower
        middle = 0.5 * (self.lower + self.upper)
        lower = np.where(self.revolute, middle - np.pi, self.lower - span)
        return Scale(
            lower, np.where(self.revolute, TURN, 3 * span), np.asarray(self.revolute)
        )

    def within(self, q: Array, slack: float = 1e-9) -> tuple[Array, NDArray[np.bool_]]:
        """Joint values (..., dof) by whole turns into the ranges, and whether all are inside."""
        middle = 0.5 * (self.lower + self.upper)
        turns = np.where(self.revolute, TURN * np.round((q - middle) / TURN), 0.0)
        inside = q - turns
        near = (inside >= self.lower - slack) & (inside <= self.upper + slack)
        return np.clip(inside, self.lower, self.upper), np.asarray(near.all(axis=-1))


def refined_ways(
    newton: Newton, target: Array, starts: Array, length: float
) -> tuple[Index, Array]:
    """Which target (k,), and joints in the unit box (k, dof), that starts (n, s, dof) lead to.

    Each way once, and those across a fold beside it, too; NaN is no start.
    """
    owner, column = np.nonzero(np.isfinite(starts[..., 0]))
    u, left = newton.refine(starts[owner, column], target[owner], 1e-3 * TOLERANCE)
    row, across = twins(newton, u)
    if len(row):
        more, left_there = newton.refine(across, target[owner[row]], 1e-3 * TOLERANCE)
        owner = np.append(owner, owner[row])
        u = np.concatenate([u, more])
        left = np.append(left, left_there)
    met = left <= TOLERANCE * length
    order = np.argsort(owner[met], kind="stable")
    owner = owner[met][order]
    u = u[met][order]
    single = distinct(newton.scale, owner, u, SEARCH.same)
    return owner[single], u[single]


def searched_ways(
    evaluate: Evaluate,
    target: Array,
    joints: Joints,
    length: float,
    *,
    free: int | None = None,
    starts: Array | None = None,
    seed: int = 0,
) -> list[Array]:
    """Every way (b, dof) to each of some poses (n, 12) of an arm without a closed form.

    From starts that are drawn, `starts` (n, dof) first, until rounds find nothing new; a way
    suggests others: a joint half a turn on, or bent the other way.  Of a redundant arm they are
    some of infinitely many.
    """
    scale = joints.turning
    newton = Newton(Poses(evaluate, scale, length, free), scale, length)
    n = len(target)
    dof = len(joints.lower)
    rng = np.random.default_rng(seed)
    quiet = np.zeros(n, dtype=int)
    ways = [np.empty((0, dof))] * n
    tried = list(ways)
    if starts is not None:
        tried = list(starts[:, None])
    for _ in range(RANDOM.rounds):
        open_ = np.flatnonzero(quiet < RANDOM.quiet)
        rest = [int(i) for i in open_ if len(ways[i]) <= RANDOM.most]
        drawn = rng.uniform(joints.lower, joints.upper, (RANDOM.at_once, dof))
        for k in range(0, len(rest), RANDOM.together):
            some = rest[k : k + RANDOM.together]
            rows = [np.vstack([tried[i], drawn]) for i in some]
            owner = np.repeat(some, [len(part) for part in rows])
            u = scale.to_unit(np.concatenate(rows))
            u, left = newton.refine(u, target[owner], 1e-3 * TOLERANCE, RANDOM.steps)
            met = left < TOLERANCE * length
            for i in some:
                before = len(ways[i])
                ways[i] = _with_new(scale, ways[i], u[met & (owner == i)])
                quiet[i] = 0 if len(ways[i]) > before else quiet[i] + 1
                tried[i] = _suggested(scale.from_unit(ways[i][before:]), joints)
    inside = []
    for u in ways:
        q, fits = joints.within(scale.from_unit(u))
        inside.append(q[fits])
    return inside


def _with_new(scale: Scale, ways: Array, others: Array) -> Array:
    """Ways (k, dof) and those of others (n, dof) that are none of them."""
    for u in others:
        gap = np.abs(scale.difference(ways, u)).max(axis=1, initial=0.0)
        if not len(ways) or gap.min() > 10 * SEARCH.same:
            ways = np.vstack([ways, u])
    return ways


def _suggested(q: Array, joints: Joints) -> Array:
    """Starts that ways (k, dof) suggest: half a turn on, bent the other way, and both."""
    turns = np.flatnonzero(joints.revolute)
    half = np.pi * np.eye(q.shape[1])
    rows = [q[:0]]
    for k in turns:
        bent = q.copy()
        bent[:, k] *= -1.0
        rows += [bent, q + half[k]]
        rows += [bent + half[j] for j in turns if j != k]
    return np.concatenate(rows)
