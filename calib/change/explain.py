"""Explaining: which hypotheses account for a log, each with its evidence.

It is Laplace's, with the likelihood raised to the power 1 / temper: rows that resemble their
neighbours count for less than their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.normal import Factor
from ..body.settings import NATS
from ..common.arrays import Array
from .equations import Equations, Log
from .frame import Reference
from .hypotheses import FRAME, Hypothesis, freedom, hypotheses_of, is_framed
from .settings import CREEP, MARGIN, OWN

_ROWS = 200  # that hypotheses are compared on
_STEPS = 12  # of Gauss-Newton at most
_AVERAGED = 6  # explanations at most
_NOTHING_LEFT = 1e-2  # twice the nats by which a step must better the fit


@dataclass(frozen=True)
class Explanation:
    """One hypothesis, as far as a log goes."""

    hypothesis: Hypothesis
    factor: float  # times the usual size of the log's own residual
    waves: float  # sd of the joints' curves by which this arm may differ, over their prior's
    origin: Array  # (d,), parameters that it starts from
    beta: Array  # (d,), parameters of the greatest evidence
    # (d,), posterior standard deviations of those that were free, zero elsewhere
    deviation: Array
    sd: Array  # (d,), standard deviations by which they were free to change
    evidence: float  # logarithm of the tempered evidence [nats]
    fit: float  # the same without what its freedom costs, which no narrower one exceeds [nats]
    noise: float  # noise of the log, in `Reference.sizes`
    temper: float  # rows that count for one
    residual: Array  # (n, m) [unit], measured less predicted outputs of the rows that were compared

    @property
    def unchanged(self) -> bool:
        """Whether it says that the arm and its sensor are as they were."""
        return not self.hypothesis and (self.factor, self.waves) in OWN[:3]

    @property
    def name(self) -> str:
        """Such as "frame, length", or what it is where nothing is freed."""
        own = [g.removeprefix("view.") for g in self.hypothesis if g not in FRAME]
        shape = "waves of the joints" if self.waves > CREEP else "a smooth residual"
        return ", ".join([*["frame"] * is_framed(self.hypothesis), *own]) or shape


def explain(
    reference: Reference,
    log: Log,
    cause: str | None = None,
    calm: bool = False,
    link: str | None = None,
) -> tuple[Explanation, ...]:
    """All hypotheses with their evidence, best first.

    link : "placement:JOINT" that the tests name first, if they do: a link was bent or exchanged
    calm : whether nothing changed: only the sizes of the log's own residual are then compared
    """
    every = ((),) if calm else hypotheses_of(reference.structure, cause)
    if link is not None and not calm and cause != "sensor":
        every = (*every[:1], (link,), *every[1:])
    *narrow, richest = (h for h in every if is_framed(h) or calm or not reference.new)
    log = log.some(_ROWS)
    found = list[Explanation]()
    at = dict[Hypothesis, Array]()
    temper = max(reference.body.kappa, 1.0) ** 2
    for own in OWN:
        equations = Equations(reference, log, factor=own[0], waves=own[1])
        if not found:  # rows that err together count once
            rich = _fitted(richest, equations, own, temper, None, cause)
            rest = equations.rest(equations.whiten(rich.residual), rich.noise)
            temper, at[richest] = max(temper, autocorrelation_time(rest)), rich.beta
        # The richest first: none that frees less fits better, whatever its prior.
        rich = _fitted(richest, equations, own, temper, at.get(richest), cause)
        best = max((e.evidence for e in found), default=-np.inf)
        tried = [h for h in narrow if not h or rich.fit >= best - 2 * MARGIN]
        found += [
            rich,
            *(_fitted(h, equations, own, temper, at.get(h), cause) for h in tried),
        ]
        at = {e.hypothesis: e.beta for e in found}
    return tuple(sorted(found, key=lambda e: -e.evidence))


def _fitted(
    hypothesis: Hypothesis,
    equations: Equations,
    own: tuple[float, float],
    temper: float,
    start: Array | None,
    cause: str | None,
) -> Explanation:
    """Damped Gauss-Newton steps of one hypothesis, its noise by likelihood, its evidence."""
    reference = equations.reference
    log = equations.log
    structure = reference.structure
    sd = freedom(reference.body, hypothesis, cause, reference.forgotten)
    free = np.flatnonzero(sd > 0)
    full = np.zeros(len(sd))
    # without a free frame the sensor is where it was
    held = is_framed(hypothesis) or reference.new
    origin = reference.beta if held else reference.body.beta
    beta = origin if start is None else start

    def seen(beta: Array, noise: float = 0.0) -> tuple[Array, Array, float, float]:
        """Residuals, also whitened, the noise where it is not given, and the cost [nats]."""
        with np.errstate(all="ignore"):
            left = structure.residual(log.z, structure.predict(log.q, beta))
        y = equations.whiten(left)
        noise = noise or equations.most_likely_noise(y)
        moved = (beta - origin)[free] / sd[free]
        likely = float(equations.likelihood(y, noise)[0])
        return left, y, noise, 0.5 * float(moved @ moved) - likely / temper

    left, y, noise, cost = seen(beta)
    for _ in range(_STEPS):
        _, x = structure.linearise(log.q, beta, free)
        power, pull = equations.information(y, equations.whiten(x * sd[free]), noise)
        factor = Factor(power / temper + np.eye(len(free)))
        lead = pull / temper - (beta - origin)[free] / sd[free]
        step = factor.solve(lead)
        shares = 0.3 ** np.arange(6.0) if float(lead @ step) >= _NOTHING_LEFT else ()
        for share in shares:
            full[free] = share * step * sd[free]
            moved = structure.retract(beta, full)
            if seen(moved, noise)[-1] <= cost - 0.5 * _NOTHING_LEFT:
                break
        else:
            break
        beta, (left, y, noise, cost) = moved, seen(moved)
    deviation = np.zeros(len(beta))
    deviation[free] = sd[free] * np.sqrt(factor.variances()) if len(free) else 0.0
    evidence = -cost - 0.5 * factor.log_determinant()
    return Explanation(
        hypothesis,
        *own,
        origin,
        beta,
        deviation,
        sd,
        evidence,
        -cost,
        noise,
        temper,
        left,
    )


def is_changed(found: Sequence[Explanation]) -> bool:
    """Whether something else than nothing explains the log, by the margin."""
    nothing = [e.evidence for e in found if e.unchanged]
    return not nothing or found[0].evidence > max(nothing) + MARGIN


def weighed(some: Sequence[Explanation]) -> list[tuple[float, Explanation]]:
    """The explanations that count with their posterior weights, that to update by first.

    It is the best, with the least residual of the log's own that the evidence hardly tells from it.
    """
    best = some[0]
    some = [e for e in some if e.evidence > best.evidence - MARGIN][:_AVERAGED]
    weight = np.exp(np.array([e.evidence for e in some]) - best.evidence)
    chosen = list(zip((weight / weight.sum()).tolist(), some, strict=True))

    def alike(e: Explanation) -> bool:
        return e.hypothesis == best.hypothesis and e.evidence > best.evidence - NATS

    first = min(filter(alike, some), key=lambda e: OWN.index((e.factor, e.waves)))
    return sorted(chosen, key=lambda pair: pair[1] is not first)


def simplest(found: Sequence[Explanation]) -> Explanation:
    """The one that frees least, of those that the evidence hardly tells from the best."""
    some = [e for e in found if e.evidence > found[0].evidence - NATS]
    return min(some, key=lambda e: (len(e.hypothesis), -e.evidence))
