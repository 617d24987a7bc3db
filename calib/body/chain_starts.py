"""Chains that explain rows of an arm in space without a drawing of its joints.

Damped Gauss-Newton over all joint origins brings random chains to local optima.  Of rows all over
the range the best of 24 was the best there is in every case tried, of a short path in most.
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

    The search begins at the structure's own chain, that of a drawing if there is one, then tries
    random ones until the best end leaves only the rows' noise, or another one agrees.
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
    """Ends of searches that begin at some chains; only the best of these are refined.

    Rows of a short path leave a long valley, so that the best ends get more steps.

    least : share of the extents that residuals of a chain have that is exact
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
    """How many ends explain the rows as well as the best of these, but for some nats."""
    share = START.explained_share
    costs = [end.cost for end in ends if end.noise <= share]
    best = min(costs, default=0.0)
    return sum(cost < best + near for cost in costs)


def _with_fitted_chain(end: Start) -> Start:
    """An end whose nominal chain is where its parameters put origins and tip."""
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
