"""Ways: joints that are sought for several targets at once, each beside the target's index."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.scale import Scale


def by_middle(scale: Scale, target: Index, u: Array) -> Index:
    """Order of ways (n,) by target and distance to the middle of the ranges."""
    away = np.linalg.norm(scale.difference(u, np.full_like(u, 0.5)), axis=1)
    return np.lexsort((away, target))


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
