"""Chains without a drawing: joint origins found from rows alone, from random starts.

Each start turns every joint about an axis drawn at random. Damped Gauss-Newton over all origins
brings most of them to a local optimum; the best of 24 was the best there is in every case tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arm.motion import move
from ..common.arrays import Array
from ..common.rows import thinned
from .settle import settle
from .spatial import SpatialStructure
from .structure import Structure

_STARTS = 24
#: Damped steps of every start, and of the few that are best by then.
FIRST, _LAST, _KEPT = 40, 80, 4
#: So many starts that end alike, to this cost, need no others.
_AGREE, _SAME = 4, 0.5
#: Rows that they are fitted to.
_ROWS = 150


def chains(structure: SpatialStructure, q: Array, z: Array) -> Sequence[tuple[Structure, Array]]:
    """Chains that fit rows, the best first: structures at whose origins the parameters are zero."""
    rows = thinned(len(q), _ROWS)
    q, z = q[rows], z[rows]
    rng = np.random.default_rng(0)
    free = structure.prior(("placement", "tool"))
    tried: list[tuple[float, SpatialStructure]] = []
    for _ in range(_STARTS):
        drawn = _drawn(structure, z, rng)
        beta, cost, _ = settle(drawn, q, z, drawn.neutral(), free, FIRST)
        tried.append((cost, _absorbed(drawn, beta)))
        best = min(other for other, _ in tried)
        if sum(other < best + _SAME for other, _ in tried) >= _AGREE:
            break
    tried.sort(key=lambda pair: pair[0])
    found: list[tuple[float, SpatialStructure]] = []
    for _, each in tried[:_KEPT]:
        beta, cost, _ = settle(each, q, z, each.neutral(), free, _LAST)
        found.append((cost, _absorbed(each, beta)))
    found.sort(key=lambda pair: pair[0])
    return [(each, each.neutral()) for _, each in found[:2]]


def _absorbed(structure: SpatialStructure, beta: Array) -> SpatialStructure:
    """Return the structure whose nominal chain is where `beta` puts origins and tip."""
    still = move(structure.chain, np.zeros((structure.chain.joints, 1)), structure.deviations(beta))
    axes = still.axes[..., 0] / np.linalg.norm(still.axes[..., 0], axis=1, keepdims=True)
    tip, rotation = still.position[..., 0], still.rotation[..., 0]
    chain = replace(
        structure.chain, axes=axes, points=still.origins[..., 0], tip=tip, rotation=rotation
    )
    return replace(structure, chain=chain)


def _drawn(structure: SpatialStructure, z: Array, rng: np.random.Generator) -> SpatialStructure:
    """Draw a chain: axes of any direction, links as long as the workspace suggests."""
    chain, dof = structure.chain, structure.dof
    axes = rng.normal(size=(dof, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    link = structure.extent / structure.metre / np.sqrt(dof)
    steps = rng.normal(0.0, link / np.sqrt(3), size=(dof, 3))
    middle = z[:, :3].mean(axis=0) / structure.metre
    points = middle + np.cumsum(np.vstack([np.zeros(3), steps[1:]]), axis=0)
    points = points - points.mean(axis=0) + middle
    tip = points[-1] + rng.normal(0.0, link / np.sqrt(3), size=3)
    return replace(structure, chain=replace(chain, axes=axes, points=points, tip=tip))
