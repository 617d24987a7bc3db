"""The gate: which member of a structure the rows support, from simple to rich.

A member frees some blocks of parameters.  Each is fitted, and two members are compared by the
evidence, and by what each predicts of every block of rows from the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..common.arrays import Array
from .fit import Fit, Start
from .held_out import block_scores
from .rows import Rows
from .settings import FIT, NATS, STUDENT


@dataclass(frozen=True)
class Member:
    """A member as rows fit it."""

    name: str
    free: tuple[str, ...]  # blocks
    fit: Fit
    # nats of evidence against joint curves; 0 where they were not tried
    against_curves: float = 0.0

    @cached_property
    def scores(self) -> Array:
        """Negative log density (b,) of each block of rows by the others."""
        return block_scores(self.fit)


def pass_gate(
    start: Start, chain: tuple[str, ...], rows: Sequence[Rows]
) -> Member:
    """Fit members from simple to rich, each with what has passed; return the last that wins.

    Samples of a simulation have Gaussian noise, a log's is Student.  Nothing richer is tried where
    samples reach their least noise.

    start : the structure, whose members they are, and initial parameters
    chain : blocks of the simplest member that is a start for richer ones
    """
    structure = start.structure
    nu = np.inf if structure.simulated else STUDENT
    names = {frozenset(blocks): name for name, blocks in structure.members()}
    best: Member | None = None
    tried: set[frozenset[str]] = set()
    fitted: list[Member] = []
    for rung, blocks in structure.members():
        name = rung
        free = blocks
        if best is not None:
            # what has passed stays: a lens stays beneath the curves
            free = tuple(dict.fromkeys((*best.free, *blocks)))
            name = names.get(frozenset(free), f"{best.name} and {rung}")
        if frozenset(free) in tried:
            continue
        tried.add(frozenset(free))
        member = _member_of(name, free, rows, start, nu)
        if member is None:
            continue
        fitted.append(member)
        if best is None or _wins(member, best):
            best = member
            if set(chain) <= set(free):
                start = Start(structure, member.fit.beta)
        if structure.simulated and _is_exact(member.fit):
            break
    if best is None:
        raise np.linalg.LinAlgError("no member of the body could be fitted")
    return replace(best, against_curves=_doubt_of_curves(best, fitted))


def _member_of(
    name: str,
    free: tuple[str, ...],
    rows: Sequence[Rows],
    start: Start,
    nu: float,
) -> Member | None:
    """A member with some blocks free, None where the rows do not determine them."""
    structure = start.structure
    try:
        prior = structure.prior(free)
        fit = Fit(structure, rows, start.beta, prior, nu=nu)
        if np.isfinite(nu):
            fit.maximise(steps=10, tolerance=FIT.settled)
        else:
            # the maximum of exact rows may be far along a curved valley, such as that of a lens
            fit.search(FIT.search_steps_of_exact)
            fit.maximise(
                steps=FIT.steps_of_exact, tolerance=FIT.settled_of_exact
            )
        return Member(name, free, fit)
    except np.linalg.LinAlgError:
        return None


def _wins(richer: Member, simpler: Member) -> bool:
    """Whether a richer member is better by both measures.

    Either its held-out score gains more than one paired standard error over the blocks and the
    evidence agrees, or the evidence gains three nats and the score agrees.  The blocks of few rows
    are too noisy to decide alone; the evidence alone trusts the noise model too much.  Correlated
    residuals count once for their autocorrelation time.
    """
    nats = richer.fit.log_evidence - simpler.fit.log_evidence
    nats /= richer.fit.autocorrelation
    has_old = np.isfinite(simpler.scores)
    # the scores of richer members, which are not needed then, take half of the time
    if nats <= 0 and has_old.any():
        return False
    has_new = np.isfinite(richer.scores)
    if has_new.sum() < has_old.sum():
        return False
    gains = simpler.scores - richer.scores
    gains = gains[has_new & has_old]
    if not len(gains):
        return bool(has_new.any())
    gain = gains.mean()
    if gain <= 0 or nats <= 0:
        return False
    error = np.inf
    if len(gains) > 1:
        deviation = gains.std(ddof=1)
        error = deviation / np.sqrt(len(gains))
    return bool(gain > error or nats > NATS)


def _is_exact(fit: Fit) -> bool:
    """Whether a fit's noise is next to the least that rows have."""
    least = 1.5 * fit.readings[0].floor
    return bool((fit.noise <= least).all())


def _doubt_of_curves(best: Member, fitted: Sequence[Member]) -> float:
    """Nats of evidence for the best member against those with joint curves; 0 without any."""
    with_curves = [
        member.fit.log_evidence for member in fitted if "curve" in member.free
    ]
    gain = best.fit.log_evidence - max(with_curves, default=-np.inf)
    if not np.isfinite(gain):
        return 0.0
    return gain / best.fit.autocorrelation
