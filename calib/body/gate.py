"""The gate: which member of a structure the rows support, from simple to rich."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .fit import Fit
from .held_out import HeldOut, leave_blocks_out
from .structure import Array


@dataclass(frozen=True)
class Tried:
    """One member that the gate tried.

    Attributes
    ----------
    name : str
    error : float
        Mean held-out error over ten contiguous blocks [unit].
    score : float
        Mean negative log predictive density, up to a constant.
    parameters : int
    """

    name: str
    error: float
    score: float
    parameters: int


@dataclass(frozen=True)
class Passed:
    """The member that passed the gate, with its held-out predictions."""

    name: str
    free: tuple[str, ...]
    fit: Fit
    held_out: HeldOut
    tried: tuple[Tried, ...]


def wins(richer: Array, simpler: Array) -> bool:
    """Whether blockwise costs of the richer member are lower by one paired standard error."""
    known = np.isfinite(richer) & np.isfinite(simpler)
    if np.isfinite(richer).sum() < np.isfinite(simpler).sum():
        return False
    gain = simpler[known] - richer[known]
    if len(gain) < 2:
        return bool(len(richer) and np.isfinite(richer).all() and not np.isfinite(simpler).any())
    return bool(gain.mean() > gain.std(ddof=1) / np.sqrt(len(gain)))


def choose_member(
    members: tuple[tuple[str, tuple[str, ...]], ...],
    fit: Callable[[tuple[str, ...]], Fit],
    enough: Callable[[Fit], bool],
) -> Passed:
    """Fit members from simple to rich; a richer one must win by one paired standard error.

    Parameters
    ----------
    members : tuple of (name, groups)
    fit : callable
        Fits the member with these groups.
    enough : callable
        Whether a fit is as good as the numbers allow, so that nothing richer is tried.
    """
    best: Passed | None = None
    tried: list[Tried] = []
    for name, free in members:
        try:
            made = fit(free)
            held = leave_blocks_out(made)
        except np.linalg.LinAlgError:
            continue
        tried.append(
            Tried(name, float(np.mean(held.error)), float(np.mean(held.score)), len(made.active))
        )
        if best is None or wins(
            held.blockwise(held.score), best.held_out.blockwise(best.held_out.score)
        ):
            best = Passed(name, free, made, held, ())
        if enough(made):
            break
    if best is None:
        raise np.linalg.LinAlgError("no member of the body could be fitted")
    return Passed(best.name, best.free, best.fit, best.held_out, tuple(tried))
