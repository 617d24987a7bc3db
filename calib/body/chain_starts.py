"""Chains that explain rows of an arm in space without a drawing of its joints.

Damped Gauss-Newton over all joint origins brings random chains to local optima.  With rows all over
the range the best of 24 was the global one in every case tried, with a short path in most.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from ..common.arrays import Array
from ..common.rows import row_lengths
from .fit import Start
from .rows import Rows
from .settings import START
from .spatial import SpatialStructure


def chains(structure: SpatialStructure, rows: Rows) -> list[Start]:
    """Chains that fit rows, the best first; at their origins the parameters are zero.

    The search begins at the structure's own chain, such as a drawing's, then tries random ones
    until the best end leaves only the rows' noise, or another one agrees.
    """
    noise = 0.0
    if rows.noise is not None:
        noise = float(np.max(rows.noise))
    least = max(START.exact_share, noise / structure.extent)
    begins = _beginnings(structure, rows.z)
    ends: list[Start] = []
    for _ in range(START.rounds):
        some = islice(begins, START.chains)
        ends += _ends(some, rows, least)
        ends.sort(key=lambda end: end.cost)
        if ends[0].noise <= least:
            break
        if _agreeing(ends, START.nats_of_best_two) > 1:
            break
    return [_with_fitted_chain(end) for end in ends[: START.agreeing_ends]]


def _beginnings(
    structure: SpatialStructure, z: Array
) -> Iterator[SpatialStructure]:
    """Yield a structure, then random chains without an end."""
    rng = np.random.default_rng(0)
    yield structure
    while True:
        yield _random_chain(structure, z, rng)


def _ends(
    begins: Iterable[SpatialStructure], rows: Rows, least: float
) -> list[Start]:
    """Ends of searches from some chains, the best of which get more steps.

    With rows of a short path an end lies far along a valley.

    least : noise of a chain that is exact [extents]
    """
    ends: list[Start] = []
    for begin in begins:
        start = Start(begin, begin.neutral())
        end = _after_steps(start, rows, START.steps)
        ends.append(end)
        if end.noise <= least:
            break
        if _agreeing(ends, START.nats_of_agreeing_ends) >= START.agreeing_ends:
            break
    for count, steps in START.further_steps:
        ends.sort(key=lambda end: end.cost)
        best = ends[:count]
        ends = [_after_steps(end, rows, steps) for end in best]
    return ends


def _after_steps(start: Start, rows: Rows, steps: int) -> Start:
    """A start after damped steps of the chain, which may be anywhere."""
    prior = start.structure.prior(("placement", "tool"))
    return start.run(rows, prior, steps)


def _agreeing(ends: list[Start], near: float) -> int:
    """Number of ends that explain the rows, and within `near` nats of the best."""
    share = START.explained_share
    costs = [end.cost for end in ends if end.noise <= share]
    best = min(costs, default=0.0)
    return sum(cost < best + near for cost in costs)


def _with_fitted_chain(end: Start) -> Start:
    """The end with its fitted origins and tip as the nominal chain."""
    structure = end.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - chains are in space
    zero = np.zeros((structure.chain.joints, 1))
    state = structure.move(zero, end.beta)
    axes = state.axes[..., 0]
    lengths = row_lengths(axes)[:, None]
    chain = replace(
        structure.chain,
        axes=axes / lengths,
        points=state.origins[..., 0],
        tip=state.position[..., 0],
        rotation=state.rotation[..., 0],
    )
    fitted = replace(structure, chain=chain)
    return replace(end, structure=fitted, beta=fitted.neutral())


def _random_chain(
    structure: SpatialStructure, z: Array, rng: np.random.Generator
) -> SpatialStructure:
    """Draw a chain: axes of any direction, links as long as the workspace suggests."""
    dof = structure.dof
    axes = rng.normal(size=(dof, 3))
    axes /= row_lengths(axes)[:, None]
    extent = structure.extent / structure.metre
    link = extent / np.sqrt(3 * dof)
    steps = link * rng.normal(size=(dof, 3))
    points = np.cumsum(steps, axis=0)
    middle = z[:, :3].mean(axis=0)
    middle /= structure.metre
    points += middle - points.mean(axis=0)
    last = link * rng.normal(size=3)
    tip = points[-1] + last
    chain = replace(structure.chain, axes=axes, points=points, tip=tip)
    return replace(structure, chain=chain)
