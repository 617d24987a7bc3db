"""Tracking: joints that stay on one branch while their target moves."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..maps.map import Map
from .newton import Newton, Stand
from .search import Search
from .settings import SEARCH


@dataclass(frozen=True)
class TrackingSettings:
    """How joints follow a target."""

    # of the ranges: joints that move further are looked at closely
    smooth: float = 0.05
    # share of a step: joints that do not follow a smaller one leave their branch
    least: float = 1e-3
    # of the workspace, and of its nodes' spacing: targets further away from all nodes are
    # not followed
    beyond: float = 0.1
    spacings: float = 1.5
    front: int = 8  # solutions of redundant joints that set out together
    # iterations of a small step: more are of a target out of reach
    few: int = 20
    # of the way to the middle: so far redundant joints drift there
    wish: float = 0.02


TRACKING = TrackingSettings()


def follow_targets(
    search: Search, x: Array, close: Mask, start: Array | None
) -> tuple[Array, Index]:
    """Joints (k, dof) that follow targets `x` (k, m) in their order, with as few jumps as possible.

    Also the rows that joints reach only by leaving their branch.  `close` (k,) are the targets
    that are close enough to what the arm reaches to be followed.

    Every solution of the first target sets out, of redundant joints those nearest to their middle,
    or the one nearest to `start` (dof,); the one that gets furthest is taken, of several the one
    that moves least.  Where it ends the solutions of the next target set out, and so on.  Out of
    reach joints stay as close as they can, which is no jump; far beyond they wait.
    """
    near = np.flatnonzero(close)
    lost = not len(near)
    if lost:  # the first alone: nothing more is learned from the others
        near = np.array([0])
    targets = x[near]
    if start is None and not lost:
        front = _front(search, targets[0])
    else:
        wish = start
        if wish is None:
            wish = np.full(search.newton.scale.span.shape, 0.5)
        front, _ = search.solve(targets[:1], wish[None])
    rows = _furthest(search, targets, front)
    jumps: list[int] = []
    while len(rows) < len(targets):
        rest = targets[len(rows) :]
        jumps.append(len(rows))
        front = _front(search, rest[0])
        # of branches that are as good the closest one: the first counts
        gap = search.newton.away(front, rows[-1])
        order = np.argsort(gap, kind="stable")
        further = _furthest(search, rest, front[order])
        rows = np.concatenate([rows, further])
    # where joints wait: at the last target that is close
    places = np.arange(len(x))
    latest = np.searchsorted(near, places, side="right") - 1
    joints = rows[np.maximum(latest, 0)]
    jump_places = np.array(jumps, dtype=np.intp)
    jump_rows = near[jump_places]
    return joints, jump_rows


def close_to_map(sensory: Map, x: Array) -> Mask:
    """Whether targets (k, m) are close enough to nodes of the map to be followed."""
    place = sensory.scale.to_unit(x)
    away, _ = sensory.nearest(place)
    spacings = TRACKING.spacings * sensory.spacing
    furthest = max(TRACKING.beyond, spacings)
    return np.asarray(away[:, 0] <= furthest)


def _front(search: Search, x: Array) -> Array:
    """Solutions of one target, of redundant joints some of each family, (n, dof)."""
    families = search.solve_all(x[None]).u
    if not search.redundant:
        return families
    others = search.every(x[None]).u
    front = np.concatenate([families, others])
    return front[: TRACKING.front]


def _furthest(search: Search, x: Array, front: Array) -> Array:
    """Rows of the joints (n, dof) that follow targets (k, m) furthest, (at most k, dof)."""
    history = [front]
    length = np.zeros(len(front))
    alive = np.arange(len(front))
    for before, target in itertools.pairwise(x):
        rows = history[-1].copy()
        u = rows[alive]
        moved, going = _advance(
            search,
            u,
            before,
            target,
        )
        if not going.any():
            break
        rows[alive] = moved
        length[alive] += search.newton.away(moved, u)
        alive = alive[going]
        history.append(rows)
    lengths = length[alive].round(6)
    shortest = np.argmin(lengths)
    best = alive[shortest]
    return np.stack(history)[:, best]


def _advance(
    search: Search, start: Array, begin: Array, end: Array
) -> tuple[Array, Mask]:
    """Joints (n, dof) moved along a line, in pieces if far, and whether they kept to it."""
    newton = search.newton
    line = end - begin
    u = start.copy()
    share = np.zeros(len(u))  # of the line that joints have followed
    piece = np.ones(len(u))
    rows = np.arange(len(u))
    first = True
    while len(rows):
        ahead = np.minimum(share[rows] + piece[rows], 1.0)
        targets = begin + ahead[:, None] * line
        stand = _step(newton, u[rows], targets)
        shift = newton.away(stand.u, u[rows])
        smooth = shift <= TRACKING.smooth
        met = newton.is_met(stand.miss)
        smooth &= met | (ahead < 1.0)
        if first and not smooth.all() and not _reaches(search, end):
            smooth[:] = True  # joints are as close as they can be
        first = False
        moved = rows[smooth]
        u[moved] = stand.u[smooth]
        share[moved] = ahead[smooth]
        piece[rows] *= np.where(smooth, 2.0, 0.5)
        going = share < 1.0
        going &= piece >= TRACKING.least
        rows = np.flatnonzero(going)
    return u, share == 1.0


def _step(newton: Newton, u: Array, targets: Array) -> Stand:
    """Joints (n, dof) of the next targets (n, m); spare ones drift to their middle."""
    if newton.redundant:
        middle = np.full(u.shape, 0.5)
        wish = newton.scale.difference(middle, u)
        here = newton.at(u, targets)
        drift = newton.tangent(here, TRACKING.wish * wish)
        u = u + drift
    return newton.refine(
        u,
        targets,
        SEARCH.close,
        TRACKING.few,
    )


def _reaches(search: Search, x: Array) -> bool:
    """Whether the links lead to joints that meet a target (m,)."""
    newton = search.newton
    targets = x[None]
    owner, start = search.starts.of(targets)
    stand = newton.refine(start, targets[owner], SEARCH.close)
    met = newton.is_met(stand.miss)
    return bool(met.any())
