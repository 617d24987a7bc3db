"""Search: of all joints that do a task the nearest to some, or every one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.scale import Scale
from .newton import Newton
from .settings import SEARCH

Candidates = tuple[Index, Array]
"""Joints (k, dof) of the unit box, and which target each is for (k,), ascending."""


class Starts(Protocol):
    """Where ways to targets (n, k) may begin."""

    def of(self, x: Array) -> Candidates:
        """Starts that lead to the ways there are."""
        ...

    def more(self, x: Array) -> Candidates:
        """Further starts, for targets that those have missed."""
        ...


@dataclass(frozen=True)
class Search:
    """One search for every task: starts, Newton steps, and what lies across a fold."""

    newton: Newton
    starts: Starts
    sure: float  # so near to what was asked no other way is nearer

    def nearest(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) nearest to `near` (n, dof) for targets `x`, and what is missing (n,)."""
        newton = self.newton
        u, miss = newton.settle(near, x, near)
        answer = _Best(newton, x, near, u, miss)
        rows = answer.unsure(self.sure)
        if len(rows):
            owner, start = self.starts.of(x[rows])
            owner = rows[owner]
            likely = answer.likely(owner, start)
            answer.improve(owner[likely], start[likely])
        rows = answer.unsure(SEARCH.beside)
        if len(rows) and not newton.redundant:
            row, across = twins(newton, answer.u[rows], x[rows])
            answer.improve(rows[row], across)
        rows = np.flatnonzero(~newton.met(answer.miss))
        if len(rows):
            owner, start = self.starts.more(x[rows])
            answer.improve(rows[owner], start)
        return answer.u, answer.miss

    def every(self, x: Array) -> tuple[Index, Array, Array]:
        """Every way: of which target (k,), ascending, joints (k, dof), what is missing (k,).

        Of redundant joints these are some of infinitely many.
        """
        newton = self.newton
        target, u = self.starts.of(x)
        u, miss = newton.refine(u, x[target])
        if newton.redundant:
            owner, start = self.starts.more(x)
        else:  # where branches meet they change much
            row, across = twins(newton, u, x[target])
            beside = np.unique(target[row])
            owner, start = self.starts.more(x[beside])
            owner = np.append(target[row], beside[owner])
            start = np.concatenate([across, start])
        more, missing = newton.refine(start, x[owner])
        target = np.append(target, owner)
        u = np.concatenate([u, more])
        miss = np.append(miss, missing)
        met = newton.met(miss)
        target, u, miss = by_middle(
            newton.scale, target[met], u[met], miss[met]
        )
        single = distinct(newton.scale, target, u, SEARCH.same)
        return target[single], u[single], miss[single]


@dataclass
class _Best:
    """The best joints so far for some targets, and how far they miss them."""

    newton: Newton
    x: Array
    near: Array
    u: Array
    miss: Array

    def unsure(self, sure: float) -> Index:
        """Targets that are missed, or met further than `sure` from where joints should be."""
        far = self.newton.away(self.u, self.near) > sure
        return np.flatnonzero(far | ~self.newton.met(self.miss))

    def likely(self, owner: Index, start: Array) -> Mask:
        """Which starts (k, dof) may lead to joints that are nearer than the best."""
        newton = self.newton
        away = newton.away(start, self.near[owner])
        best = newton.away(self.u, self.near)
        first = np.full(len(self.u), np.inf)
        np.minimum.at(first, owner, away)
        met = newton.met(self.miss)
        other = newton.away(start, self.u[owner]) >= 0.5 * SEARCH.margin
        nearer = other & (away <= best[owner] + SEARCH.margin)
        if newton.redundant:  # each slide takes long
            return np.where(
                met[owner], nearer, away <= first[owner] + SEARCH.surely
            )
        return nearer | ~met[owner]

    def improve(self, owner: Index, start: Array) -> None:
        """Replace joints by better ones that starts (k, dof) for targets (k,) lead to.

        A target that is met goes before one that is missed, then what is near counts.
        """
        if not len(owner):
            return
        newton = self.newton
        others, missing = newton.settle(start, self.x[owner], self.near[owner])
        owner = np.concatenate([np.arange(len(self.u)), owner])
        u = np.concatenate([self.u, others])
        miss = np.concatenate([self.miss, missing])
        missed = ~newton.met(miss)
        away = newton.away(u, self.near[owner])
        order = np.lexsort((np.where(missed, miss, away), missed, owner))
        best = order[np.searchsorted(owner[order], np.arange(len(self.u)))]
        self.u = u[best]
        self.miss = miss[best]


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
    if not len(rows):
        return rows, u[:0]
    side = sides[rows, :, -1]
    flat = directions[rows, -1]
    shift = SEARCH.probe * flat
    probes = np.concatenate([u[rows] + shift, u[rows] - shift])
    ahead, behind = np.split(
        newton.task.residual(probes, np.tile(x[rows], (2, 1)))[1], 2
    )
    change = (side[:, None] @ (ahead - behind) @ flat[:, :, None])[:, 0, 0]
    rate = change / (2 * SEARCH.probe)
    reach = -2.0 * size[rows, -1] / np.where(rate == 0.0, np.inf, rate)
    near = (np.abs(reach) < SEARCH.beyond) & (reach != 0.0)
    across = u[rows[near]] + reach[near, None] * flat[near]
    return rows[near], newton.clip(across)


def by_middle(
    scale: Scale, target: Index, u: Array, miss: Array
) -> tuple[Index, Array, Array]:
    """Ways sorted by target and distance to the middle of the ranges."""
    away = np.linalg.norm(scale.difference(u, np.full_like(u, 0.5)), axis=1)
    order = np.lexsort((away, target))
    return target[order], u[order], miss[order]


def rank_within(owner: Index) -> Index:
    """Index of each row within those of its owner, of owners (n,) that ascend."""
    return np.arange(len(owner)) - np.searchsorted(owner, owner)


def distinct(
    scale: Scale, target: Index, u: Array, apart: Array | float
) -> Mask:
    """Which joints (n, dof), sorted by target, are `apart` from all earlier ones that stay."""
    stays = np.ones(len(u), dtype=bool)
    apart = np.broadcast_to(apart, len(u))
    for lag in range(1, int(np.bincount(target).max(initial=0))):
        later = np.flatnonzero(target[lag:] == target[:-lag]) + lag
        gap = np.abs(scale.difference(u[later], u[later - lag])).max(axis=1)
        same = gap < np.minimum(apart[later], apart[later - lag])
        stays[later[same & stays[later - lag]]] = False
    return stays


def drawn(n: int, dof: int, beyond: float = 0.0) -> Array:
    """Joints (n, dof) at random all over their ranges; those `beyond` a limit stand at it."""
    u = np.random.default_rng(0).random((n, dof))
    return np.clip(u * (1.0 + 2.0 * beyond) - beyond, 0.0, 1.0)


def with_others(
    target: Index, u: Array, targets: int, others: Array
) -> Candidates:
    """Starts (k, dof) of targets (k,), and for each of all targets the same others."""
    owner = np.append(target, np.repeat(np.arange(targets), len(others)))
    order = np.argsort(owner, kind="stable")
    return owner[order], np.concatenate([u, np.tile(others, (targets, 1))])[
        order
    ]
