"""Solutions: joints for several targets at once, each with the index of its target."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.rows import row_lengths
from ..common.scale import Scale
from .settings import SOLVER


@dataclass(frozen=True)
class Solutions:
    """Solutions of targets, one row each."""

    target: Index  # (n,), number of each one's target, ascending
    u: Array  # (n, dof), joints of the unit box
    distance: Array  # (n,), length of the residual

    def rows(self, index: Index | Mask) -> Solutions:
        """Some of the solutions."""
        return Solutions(
            self.target[index],
            self.u[index],
            self.distance[index],
        )

    def joined(self, other: Solutions, scale: Scale) -> Solutions:
        """These and other solutions, by target and distance to the middle of the ranges."""
        target = np.concatenate([self.target, other.target])
        u = np.concatenate([self.u, other.u])
        distance = np.concatenate([self.distance, other.distance])
        return Solutions(target, u, distance).sorted(scale)

    def sorted(self, scale: Scale) -> Solutions:
        """The solutions by target and distance to the middle of the ranges."""
        return self.rows(by_middle(scale, self.target, self.u))


def by_middle(scale: Scale, target: Index, u: Array) -> Index:
    """Order (n,) by target and distance of joints (n, dof) to the middle of the unit box."""
    away = scale.difference(u, np.full_like(u, 0.5))
    return np.lexsort((row_lengths(away), target))


def slices(target: Index, n: int) -> Iterator[slice]:
    """Rows of each of `n` targets, whose indices (k,) ascend."""
    edges = np.searchsorted(target, np.arange(n + 1)).tolist()
    # one at a time: lists of them took a sixth of `inverse_all`
    return map(slice, edges, edges[1:])


def rank_within(owner: Index) -> Index:
    """Index of each row within those of its owner, of owners (n,) that ascend."""
    row = np.arange(len(owner))
    first_row = np.searchsorted(owner, owner)
    return row - first_row


def random_joints(count: int, dof: int) -> Array:
    """Joints (count, dof) at random all over the unit box, many at a limit; always the same."""
    u = np.random.default_rng(0).random((count, dof))
    outwards = SOLVER.overhang * (2.0 * u - 1.0)
    return np.clip(u + outwards, 0.0, 1.0)


def distinct(
    scale: Scale, target: Index, u: Array, apart: Array | float
) -> Mask:
    """Which joints (n, dof) stay: those `apart` from all earlier ones of their target, (n,).

    target : (n,), ascending
    apart : one or (n,), share of the joints' ranges; of two rows the smaller one counts
    """
    stays = np.ones(len(u), dtype=bool)
    apart = np.broadcast_to(apart, len(u))
    rank = rank_within(target)
    for k in range(int(rank.max(initial=0))):
        # row k of each target, whose own fate is settled by now, against those after it
        later = np.flatnonzero(stays & (rank > k))
        earlier = later - rank[later] + k
        difference = scale.difference(u[later], u[earlier])
        away = np.abs(difference).max(axis=1)
        least = np.minimum(apart[later], apart[earlier])
        same = stays[earlier] & (away < least)
        stays[later[same]] = False
    return stays
