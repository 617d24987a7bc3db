"""The gate: which member of a structure the rows support, from simple to rich."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .fit import BLOCKS, Fit
from .held_out import HeldOut, leave_blocks_out
from .settings import NATS, SETTLED
from .starts import Start


@dataclass(frozen=True)
class Passed:
    """The member that passed the gate, with its held-out predictions."""

    name: str
    free: tuple[str, ...]
    fit: Fit
    held_out: HeldOut
    tried: Mapping[str, float]  # log evidence of each member that was tried, up to a constant

    def against(self, name: str) -> float:
        """Nats of evidence against the best tried member with `name`; 0 where there is none."""
        other = [evidence for tried, evidence in self.tried.items() if name in tried]
        return (self.fit.evidence - max(other)) / self.fit.autocorrelation if other else 0.0


def _wins(richer: Passed, simpler: Passed) -> bool:
    """Whether a richer member is better in both currencies.

    Either its held-out score gains more than one paired standard error over the blocks and the
    evidence agrees, or the evidence gains three nats and the score agrees.  The blocks of few rows
    are too noisy to tell alone; the evidence alone trusts the noise model too much.  Correlated
    residuals count once for their autocorrelation time.
    """
    new = richer.held_out.blockwise(richer.held_out.score)
    old = simpler.held_out.blockwise(simpler.held_out.score)
    known = np.isfinite(new) & np.isfinite(old)
    if np.isfinite(new).sum() < np.isfinite(old).sum():
        return False
    if not known.any():
        return bool(np.isfinite(new).any())
    gain = (old - new)[known]
    evidence = (richer.fit.evidence - simpler.fit.evidence) / richer.fit.autocorrelation
    if gain.mean() <= 0 or evidence <= 0:
        return False
    error = gain.std(ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else np.inf
    return bool(gain.mean() > error or evidence > NATS)


def pass_gate(
    start: Start, chain: tuple[str, ...], q: Array, z: Array, nu: float, floor: Array
) -> Passed:
    """Fit members from simple to rich, each with what has passed; a richer one must win.

    start : the structure, whose members they are, and parameters to begin with
    chain : groups of the simplest member that is a start for richer ones
    q, z : (n, dof), (n, m)
    nu : degrees of freedom of the Student noise; infinite for Gaussian
    floor : (m,), least noise; nothing richer is tried where samples of a simulation reach it
    """
    structure, gaussian = start.structure, not np.isfinite(nu)

    def fit(free: tuple[str, ...], begin: Array) -> Fit:
        made = Fit(structure, q, z, begin, structure.prior(free), nu=nu, floor=floor)
        if gaussian:  # exact rows may be far along a curved valley, such as that of a lens
            made.settle(40)
        steps, tolerance = (20, 1e-3) if gaussian else (10, SETTLED)
        return made.maximise(steps=steps, tolerance=tolerance)

    def enough(made: Fit) -> bool:
        return gaussian and bool((made.noise <= 1.5 * floor).all())

    best: Passed | None = None
    tried: dict[str, float] = {}
    members = structure.members()
    names = {frozenset(groups): name for name, groups in members}
    seen: list[set[str]] = []
    for own, groups in members:
        # What has passed stays: a lens stays beneath the curves.
        free = groups if best is None else tuple(dict.fromkeys((*best.free, *groups)))
        if set(free) in seen:
            continue
        seen.append(set(free))
        name = names.get(frozenset(free), own if best is None else f"{best.name} and {own}")
        begin = best.fit.beta if best and set(chain) <= set(best.free) else start.beta
        try:
            made = fit(free, begin)
            if enough(made) and set(free) != set(groups):
                alone = fit(groups, begin)  # what passed before may have been a makeshift
                if enough(alone):
                    name, free, made = own, groups, alone
            held = leave_blocks_out(made, (BLOCKS,))
        except np.linalg.LinAlgError:
            continue
        tried[name] = made.evidence
        candidate = Passed(name, free, made, held, tried)
        if best is None or _wins(candidate, best):
            best = candidate
        if enough(made):
            break
    if best is None:
        raise np.linalg.LinAlgError("no member of the body could be fitted")
    return best
