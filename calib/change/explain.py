"""Explaining: which sets of causes account for a log, each with its evidence.

The evidence is Laplace's, with the likelihood raised to the power 1 / temper: rows that resemble
their neighbours count for less than their number.  Causes are added one by one, each of which pays
the logarithm of how many there are; the best sets are fitted to convergence, and where that leads
far the system is set up again there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

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
    # Gauss-Newton steps at most, and what is left of one that does not better the fit
    steps: int = 12
    shorter: float = 0.3
    # twice the nats by which a step must promise to better the fit
    nothing_left: float = 1e-2


SEARCH = SearchSettings()


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes that accounts for a log, as the linear system has it or fitted."""

    causes: tuple[str, ...]
    level: Level
    reference: Reference
    indices: Indices  # parameters that are free
    beta: Array  # (d,), parameters of the greatest evidence
    sd: Array  # (d,), standard deviations by which they were free to change
    evidence: float  # logarithm of the tempered evidence [nats]
    temper: float  # rows that count for one
    # of a fit: (d,), posterior standard deviations of those that are free, zero elsewhere
    deviation: Array
    noise: float  # noise of the log, in `Reference.sizes`
    # (n, m) [unit], measured less predicted outputs of the rows compared
    residual: Array

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of the parameters that are free."""
        labels = self.reference.structure.labels
        names = [labels[k].group for k in self.indices.tolist()]
        return tuple(dict.fromkeys(names))

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
        waves = self.level.waves > CREEP
        shape = "waves of the joints" if waves else "a smooth residual"
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
        self.temper = max(reference.body.kappa, 1.0) ** 2
        labels = [structure.labels[k].group for k in system.indices.tolist()]
        groups = tuple(dict.fromkeys(labels))
        self.sd = freedom(reference.body, groups, cause, reference.forgotten)
        self.start = np.sort(indices_of(structure, always))
        singles = single_causes(structure, cause)
        self.singles = self._free(singles)
        self.sets = self._free(rich_sets(structure, singles))
        self.cost = float(np.log(max(len(self.singles) + len(self.sets), 1)))
        self.informations: dict[Level, Information] = {}

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

    def candidates(self) -> list[Explanation]:
        """Return nothing, sets that belong together, and causes added one by one, best first."""
        candidates: dict[tuple[str, ...], list[Explanation]] = {}
        candidates[()] = self.by_level(())
        for name in self.sets:
            candidates[(name,)] = self.by_level((name,))
        beam: list[tuple[str, ...]] = [()]
        best = candidates[()][0].evidence
        for _ in range(SEARCH.causes):
            longer: dict[tuple[str, ...], list[Explanation]] = {}
            for causes in beam:
                for name in self.singles:
                    key = tuple(sorted({*causes, name}))
                    if len(key) > len(causes) and key not in longer:
                        longer[key] = self.by_level(key)
            beam = sorted(longer, key=lambda key: -longer[key][0].evidence)
            beam = beam[: SEARCH.beam]
            candidates.update(longer)
            if not beam or longer[beam[0]][0].evidence < best + SEARCH.better:
                break
            best = longer[beam[0]][0].evidence
        return _best_first([*chain.from_iterable(candidates.values())])

    def by_level(
        self, causes: tuple[str, ...], levels: Sequence[Level] = OWN
    ) -> list[Explanation]:
        """Return a set of causes in the linear system at each level, the best first."""
        system = self.system
        reference = system.reference
        parameters = {**self.singles, **self.sets}
        parts = [parameters[cause] for cause in causes]
        indices = np.unique(np.concatenate([self.start, *parts]))
        indices = indices.astype(np.intp)
        places = np.searchsorted(system.indices, indices)
        sd = np.zeros(len(self.sd))
        sd[indices] = self.sd[indices]
        explanations = []
        for level in levels:
            if level not in self.informations:
                self.informations[level] = Information(
                    system, level, self.sd[system.indices]
                )
            information = self.informations[level]
            value, step = information.evidence(places, self.temper)
            full = np.zeros(len(sd))
            full[indices] = step * sd[indices]
            explanations.append(
                Explanation(
                    causes=causes,
                    level=level,
                    reference=reference,
                    indices=indices,
                    beta=full,
                    sd=sd,
                    evidence=value - self.cost * len(causes),
                    temper=self.temper,
                    deviation=sd,
                    noise=1.0,
                    residual=system.residual,
                )
            )
        return _best_first(explanations)

    def fitted(self, candidate: Explanation) -> Explanation:
        """Fit a set by damped Gauss-Newton steps: its noise by likelihood, its evidence."""
        reference = candidate.reference
        structure = reference.structure
        log = self.system.log
        unknown = self.system.unknown(candidate.level)
        free = candidate.indices
        sd = candidate.sd[free]
        cost = self.cost * len(candidate.causes)
        best = candidate
        best_fit = -np.inf
        moved = np.zeros(len(free))  # in standard deviations
        step = candidate.beta[free] / sd
        for _ in range(SEARCH.steps):
            full = np.zeros(structure.size)
            full[free] = sd * (moved + step)
            beta = structure.retract(reference.beta, full)
            with np.errstate(all="ignore"):
                predicted, columns = structure.linearise(log.q, beta, free)
                residual = structure.residual(log.z, predicted)
            fit = -np.inf
            if np.isfinite(residual).all():
                y = unknown.whiten(residual)
                noise = unknown.most_likely_noise(y)
                fit = float(unknown.likelihood(y, noise)[0]) / self.temper
                fit -= 0.5 * float(((moved + step) ** 2).sum())
            if not fit > best_fit:
                step = SEARCH.shorter * step
                continue
            moved = moved + step
            x = unknown.whiten(columns * sd)
            power, pull = unknown.information(y, x, noise)
            factor = Factor(power / self.temper + np.eye(len(free)))
            deviation = np.zeros(structure.size)
            deviation[free] = sd * np.sqrt(np.diag(factor.inverse()))
            best_fit = fit
            best = replace(
                candidate,
                beta=beta,
                deviation=deviation,
                evidence=fit - 0.5 * factor.log_determinant() - cost,
                noise=noise,
                residual=residual,
            )
            lead = pull / self.temper - moved
            step = factor.solve(lead)
            if float(lead @ step) < SEARCH.nothing_left:
                break
        return best

    def explanations(self) -> list[Explanation]:
        """Fit the best sets; set the system up again where that leads far."""
        fits = [self.fitted(candidate) for candidate in self.by_level(())]
        causes: tuple[str, ...] | None = None
        for _ in range(SEARCH.rounds):
            candidates = self.candidates()
            fits += [self.fitted(some) for some in candidates[: SEARCH.fitted]]
            fits = _best_first(fits)
            promise = candidates[0].evidence
            if abs(fits[0].evidence - promise) < MARGIN:
                break
            if causes == fits[0].causes:
                break
            causes = fits[0].causes
            self.system = self.system.again(fits[0].beta)
            self.informations = {}
        alone = {(fit.causes, fit.level): fit for fit in reversed(fits)}
        return list(alone.values())


def _best_first(explanations: list[Explanation]) -> list[Explanation]:
    return sorted(explanations, key=lambda explanation: -explanation.evidence)


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
            (rich,) = search.by_level(tuple(search.singles), OWN[:1])
            rich = search.fitted(rich)
            unknown = system.unknown(OWN[0])
            rest = unknown.rest(unknown.whiten(rich.residual), rich.noise)
            temper = autocorrelation_time(rest)
        search.temper = max(search.temper, temper)
        if calm:
            explanations += [
                search.fitted(some) for some in search.by_level(())
            ]
        else:
            explanations += search.explanations()
    return tuple(_best_first(explanations))


def is_changed(explanations: Sequence[Explanation]) -> bool:
    """Whether something else than nothing explains the log, by the margin."""
    nothing = [some.evidence for some in explanations if some.unchanged]
    return not nothing or explanations[0].evidence > max(nothing) + MARGIN


def least_residual(explanations: Sequence[Explanation]) -> Explanation:
    """The best, with the least residual of the log's own that the evidence hardly tells from it."""
    best = explanations[0]
    alike = [
        some
        for some in explanations
        if some.causes == best.causes and some.evidence > best.evidence - NATS
    ]
    return min(alike, key=lambda some: OWN.index(some.level))


def simplest(explanations: Sequence[Explanation]) -> Explanation:
    """The one that frees least, of those that the evidence hardly tells from the best."""
    least = explanations[0].evidence - NATS
    some = [one for one in explanations if one.evidence > least]
    return min(some, key=lambda one: (len(one.indices), -one.evidence))
