"""Chains that explain rows of an arm in space of which no drawing says where its joints are.

Damped Gauss-Newton over all joint origins brings most random chains to a local optimum; the best of
24 was the best there is in every case tried.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..common.arrays import Array
from .rows import Rows
from .settings import START
from .spatial import SpatialStructure
from .start import Start


def chains(structure: SpatialStructure, rows: Rows) -> list[Start]:
    """Return chains that fit rows, the best first; at their origins the parameters are zero.

    The search begins at the structure's own chain, of a drawing where there is one, and goes on at
    random ones until one leaves no more than the rows' noise or several that explain them agree.
    """
    noise = 0.0 if rows.noise is None else float(np.max(rows.noise))
    least = max(START.exact, noise / structure.extent)
    rng = np.random.default_rng(0)
    ends: list[Start] = []
    begin = structure
    while len(ends) < START.chains:
        prior = begin.prior(("placement", "tool"))
        end = Start(begin, prior.mean).run(rows.q, rows.z, prior, START.steps)
        there = _absorbed(begin, end.beta)
        ends.append(replace(end, structure=there, beta=there.neutral()))
        if end.noise <= least or _agreeing(ends) >= START.alike:
            break
        begin = _drawn(structure, rows.z, rng)
    return sorted(ends, key=lambda end: end.cost)[: START.alike]


def _agreeing(ends: list[Start]) -> int:
    """Return how many ends of the search explain the rows as well as the best of these."""
    costs = [end.cost for end in ends if end.noise <= START.explained]
    best = min(costs, default=0.0)
    return sum(cost < best + START.same for cost in costs)


def _absorbed(structure: SpatialStructure, beta: Array) -> SpatialStructure:
    """Return the structure whose nominal chain is where `beta` puts origins and tip."""
    zero = np.zeros((structure.chain.joints, 1))
    still = structure.move(zero, beta)
    axes = still.axes[..., 0]
    chain = replace(
        structure.chain,
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        points=still.origins[..., 0],
        tip=still.position[..., 0],
        rotation=still.rotation[..., 0],
    )
    return replace(structure, chain=chain)


def _drawn(
    structure: SpatialStructure, z: Array, rng: np.random.Generator
) -> SpatialStructure:
    """Draw a chain: axes of any direction, links as long as the workspace suggests."""
    dof = structure.dof
    axes = rng.normal(size=(dof, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    link = structure.extent / structure.metre / np.sqrt(3 * dof)
    steps = link * rng.normal(size=(dof, 3))
    middle = z[:, :3].mean(axis=0) / structure.metre
    points = np.cumsum(steps, axis=0)
    points += middle - points.mean(axis=0)
    tip = points[-1] + link * rng.normal(size=3)
    chain = replace(structure.chain, axes=axes, points=points, tip=tip)
    return replace(structure, chain=chain)
