"""Explaining: which sets of causes account for a log, each with its evidence.

It is Laplace's, with the likelihood raised to the power 1 / temper: rows that resemble their
neighbours count for less than their number.  Causes are added one by one, each of which pays the
logarithm of how many there are; the best sets are fitted to convergence, and where that leads far
the system is set up again there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.normal import Factor
from ..body.parameters import Indices
from ..body.settings import NATS
from ..common.arrays import Array
from .causes import FRAME, freedom, indices_of, rich_sets, single_causes
from .frame import Reference
from .settings import CREEP, MARGIN, OWN, Level
from .system import Information, System


@dataclass(frozen=True)
class SearchSettings:
    """How causes are searched."""

    # that belong together at most
    causes: int = 3
    # sets of causes to which further ones are added
    beam: int = 4
    # nats by which one more cause must better the evidence
    better: float = 1.0
    # in which the system is set up at the best explanation
    rounds: int = 3
    # explanations of a round that are fitted to convergence at most
    fitted: int = 8
    # of Gauss-Newton at most
    steps: int = 12
    # twice the nats by which a step must better the fit
    nothing_left: float = 1e-2


SEARCH = SearchSettings()


@dataclass(frozen=True, eq=False)
class Candidate:
    """A set of causes in the linear system."""

    causes: tuple[str, ...]
    level: Level
    indices: Indices  # parameters that are free
    step: Array  # their change
    evidence: float
    cost: float  # of choosing these among all causes [nats]


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes fitted to a log."""

    causes: tuple[str, ...]
    level: Level
    reference: Reference
    indices: Indices  # parameters that are free
    beta: Array  # (d,), parameters of the greatest evidence
    # (d,), posterior standard deviations of those that are free, zero elsewhere
    deviation: Array
    sd: Array  # (d,), standard deviations by which they were free to change
    evidence: float  # logarithm of the tempered evidence [nats]
    noise: float  # noise of the log, in `Reference.sizes`
    temper: float  # rows that count for one
    # (n, m) [unit], measured less predicted outputs of the rows compared
    residual: Array

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of the parameters that are free."""
        labels = self.reference.structure.labels
        return tuple(
            dict.fromkeys(labels[k].group for k in self.indices.tolist())
        )

    @property
    def unchanged(self) -> bool:
        """Whether it says that the arm and its sensor are as they were."""
        return self.level.calm and not len(self.indices)

    @property
    def name(self) -> str:
        """Such as "frame, length", or what it is where nothing is freed."""
        names = [
            group.removeprefix("view.")
            for group in self.groups
            if group not in FRAME
        ]
        if FRAME[0] in self.groups:
            names.insert(0, "frame")
        shape = (
            "waves of the joints"
            if self.level.waves > CREEP
            else "a smooth residual"
        )
        return ", ".join(names) or shape


class Search:
    """Sets of causes of a log beside a reference.

    always : groups that are free in every set: a frame that no posterior tells of, a turned tool
    """

    def __init__(
        self, system: System, cause: str | None, always: Sequence[str]
    ) -> None:
        reference = system.reference
        structure = reference.structure
        self.system = system
        self._informations: dict[Level, Information] = {}
        self.temper = max(reference.body.kappa, 1.0) ** 2
        groups = tuple(
            dict.fromkeys(
                structure.labels[k].group for k in system.indices.tolist()
            )
        )
        self.sd = freedom(reference.body, groups, cause, reference.forgotten)
        self.start = np.sort(indices_of(structure, always))
        self.singles = self._free(single_causes(structure, cause))
        self.sets = self._free(rich_sets(structure, cause))
        self.cost = float(np.log(max(len(self.singles) + len(self.sets), 1)))

    def _free(self, sets: dict[str, Indices]) -> dict[str, Indices]:
        """Return the parameters of each that can be free; sets that free no more are left out."""
        free = {
            name: indices[self.sd[indices] > 0.0]
            for name, indices in sets.items()
        }
        return {
            name: indices
            for name, indices in free.items()
            if not np.isin(indices, self.start).all()
        }

    def _information(self, level: Level) -> Information:
        """What the rows tell at a level of the log's own residual."""
        if level not in self._informations:
            sd = self.sd[self.system.indices]
            self._informations[level] = Information(self.system, level, sd)
        return self._informations[level]

    def candidates(self) -> list[Candidate]:
        """Return nothing, sets that belong together, and causes added one by one."""
        found: dict[tuple[str, ...], list[Candidate]] = {
            (): self._by_level((), ())
        }
        for name, indices in self.sets.items():
            found[(name,)] = self._by_level((name,), (indices,))
        beam: list[tuple[str, ...]] = [()]
        best = found[()][0].evidence
        for _ in range(SEARCH.causes):
            longer: dict[tuple[str, ...], list[Candidate]] = {}
            for causes in beam:
                for name in self.singles:
                    key = tuple(sorted({*causes, name}))
                    if len(key) > len(causes) and key not in longer:
                        parts = [self.singles[cause] for cause in key]
                        longer[key] = self._by_level(key, parts)
            beam = sorted(longer, key=lambda key: -longer[key][0].evidence)[
                : SEARCH.beam
            ]
            found.update(longer)
            if not beam or longer[beam[0]][0].evidence < best + SEARCH.better:
                break
            best = longer[beam[0]][0].evidence
        every = [
            candidate for by_level in found.values() for candidate in by_level
        ]
        return sorted(every, key=lambda candidate: -candidate.evidence)

    def unchanged(self) -> list[Candidate]:
        """Return the sizes of the log's own residual alone."""
        return self._by_level((), ())

    def richest(self) -> Explanation:
        """Fit all causes at once."""
        parts = tuple(self.singles.values())
        (candidate,) = self._by_level(("all",), parts, OWN[:1])
        return self.fitted(candidate)

    def _by_level(
        self,
        causes: tuple[str, ...],
        parts: Iterable[Indices],
        levels: Sequence[Level] = OWN,
    ) -> list[Candidate]:
        """Return one set of causes at each level, the best first."""
        indices = np.unique(np.concatenate([self.start, *parts])).astype(
            np.intp
        )
        places = np.searchsorted(self.system.indices, indices)
        cost = self.cost * len(causes)
        candidates = []
        for level in levels:
            value, step = self._information(level).evidence(places, self.temper)
            step = step * self.sd[indices]
            candidates.append(
                Candidate(causes, level, indices, step, value - cost, cost)
            )
        return sorted(candidates, key=lambda candidate: -candidate.evidence)

    def fitted(self, candidate: Candidate) -> Explanation:
        """Fit a set by damped Gauss-Newton steps: its noise by likelihood, its evidence."""
        reference = self.system.reference
        structure = reference.structure
        log = self.system.log
        unknown = self.system.unknown(candidate.level)
        free = candidate.indices
        sd = np.zeros(structure.size)
        sd[free] = self.sd[free]
        origin = reference.beta
        full = np.zeros(structure.size)

        def state(
            beta: Array, noise: float = 0.0
        ) -> tuple[Array, Array, float, float]:
            """Residuals, also whitened, the noise where it is not given, and the cost [nats]."""
            with np.errstate(all="ignore"):
                residual = structure.residual(
                    log.z, structure.predict(log.q, beta)
                )
            y = unknown.whiten(residual)
            noise = noise or unknown.most_likely_noise(y)
            moved = (beta - origin)[free] / sd[free]
            likelihood = float(unknown.likelihood(y, noise)[0])
            return (
                residual,
                y,
                noise,
                0.5 * float(moved @ moved) - likelihood / self.temper,
            )

        full[free] = candidate.step
        starts = [structure.retract(origin, full), origin]
        beta = min(
            starts,
            key=lambda start: np.nan_to_num(state(start)[-1], nan=np.inf),
        )
        residual, y, noise, cost = state(beta)
        for _ in range(SEARCH.steps):
            columns = unknown.whiten(
                structure.linearise(log.q, beta, free)[1] * sd[free]
            )
            power, pull = unknown.information(y, columns, noise)
            factor = Factor(power / self.temper + np.eye(len(free)))
            lead = pull / self.temper - (beta - origin)[free] / sd[free]
            step = factor.solve(lead)
            shares = (
                0.3 ** np.arange(6.0)
                if float(lead @ step) >= SEARCH.nothing_left
                else ()
            )
            for share in shares:
                full[free] = share * step * sd[free]
                moved = structure.retract(beta, full)
                if state(moved, noise)[-1] <= cost - 0.5 * SEARCH.nothing_left:
                    break
            else:
                break
            beta = moved
            residual, y, noise, cost = state(beta)
        deviation = np.zeros(structure.size)
        if len(free):
            deviation[free] = sd[free] * np.sqrt(factor.variances())
        return Explanation(
            causes=candidate.causes,
            level=candidate.level,
            reference=reference,
            indices=free,
            beta=beta,
            deviation=deviation,
            sd=sd,
            evidence=-cost - 0.5 * factor.log_determinant() - candidate.cost,
            noise=noise,
            temper=self.temper,
            residual=residual,
        )

    def explanations(self) -> list[Explanation]:
        """Fit the best sets; set the system up again where that leads far."""
        fits: dict[tuple[tuple[str, ...], Level], Explanation] = {}
        best: Explanation | None = None
        for candidate in self.unchanged():
            fits[(candidate.causes, candidate.level)] = self.fitted(candidate)
        for _ in range(SEARCH.rounds):
            candidates = self.candidates()
            promised = candidates[0]
            for candidate in candidates[: SEARCH.fitted]:
                key = (candidate.causes, candidate.level)
                explanation = self.fitted(candidate)
                if key not in fits or explanation.evidence > fits[key].evidence:
                    fits[key] = explanation
            last = best
            best = max(
                fits.values(), key=lambda explanation: explanation.evidence
            )
            if abs(best.evidence - promised.evidence) < MARGIN:
                break
            if last is not None and best.causes == last.causes:
                break
            self.system = self.system.again(best.beta)
            self._informations = {}
        return list(fits.values())


def explain(
    systems: Sequence[System],
    cause: str | None,
    *,
    calm: bool,
    turned: Sequence[str] = (),
) -> tuple[Explanation, ...]:
    """Return sets of causes with their evidence, the best first.

    systems : the log beside the belief as it was, and in the frame that fits the log best where
        that is far
    calm : whether nothing changed: only the sizes of the log's own residual are then compared
    turned : groups that changed for sure, as orientations show: the tool that is turned has moved
    """
    explanations: list[Explanation] = []
    temper = 1.0
    for system in reversed(systems):
        last = system is systems[-1]
        framed = system.reference.new or (last and len(systems) > 1)
        search = Search(system, cause, (*FRAME, *turned) if framed else turned)
        if last:  # rows that err together count once
            rich = search.richest()
            unknown = system.unknown(OWN[0])
            rest = unknown.rest(unknown.whiten(rich.residual), rich.noise)
            temper = autocorrelation_time(rest)
        search.temper = max(search.temper, temper)
        if calm:
            explanations += [
                search.fitted(candidate) for candidate in search.unchanged()
            ]
        else:
            explanations += search.explanations()
    return tuple(
        sorted(explanations, key=lambda explanation: -explanation.evidence)
    )


def is_changed(explanations: Sequence[Explanation]) -> bool:
    """Whether something else than nothing explains the log, by the margin."""
    nothing = [each.evidence for each in explanations if each.unchanged]
    return not nothing or explanations[0].evidence > max(nothing) + MARGIN


def least_residual(explanations: Sequence[Explanation]) -> Explanation:
    """The best, with the least residual of the log's own that the evidence hardly tells from it."""
    best = explanations[0]
    alike = [
        each
        for each in explanations
        if each.causes == best.causes and each.evidence > best.evidence - NATS
    ]
    return min(alike, key=lambda each: OWN.index(each.level))


def simplest(explanations: Sequence[Explanation]) -> Explanation:
    """The one that frees least, of those that the evidence hardly tells from the best."""
    least = explanations[0].evidence - NATS
    some = [each for each in explanations if each.evidence > least]
    return min(some, key=lambda each: (len(each.indices), -each.evidence))
