"""Explaining: which sets of causes account for a log, each with its evidence.

The evidence is Laplace's, with the likelihood raised to the power 1 / temper: rows that resemble
their neighbours count for less than their number.  Causes are added one by one, each of which pays
the logarithm of how many there are; the best sets are fitted to convergence, and where that leads
far the system is set up again there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from ..body.normal import Factor
from ..body.parameters import Indices
from ..common.arrays import Array
from .causes import (
    FRAME,
    SETS,
    changeable,
    frame_twin,
    freedom,
    indices_of,
    single_causes,
)
from .explanation import Explanation, Place, climb
from .settings import (
    MARGIN,
    WAVES,
)
from .system import System


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
    # explanations of a round that are fitted to convergence at most, and nats from the best within
    # which they are
    fits: int = 8
    near: float = 10.0
    # one in so many sizes of the noise is compared: sets share it nearly
    coarser: int = 3
    # steps at most to the best fit of a set, and nats that one must gain
    steps: int = 12
    enough: float = 5e-3


SEARCH = SearchSettings()


class Candidate(NamedTuple):
    """A set of causes in the linear system."""

    causes: tuple[str, ...]
    waves: float  # of `WAVES`
    indices: Indices  # parameters that are free
    evidence: float  # [nats]
    step: Array  # of the parameters, in the standard deviations by which they are free


CauseNames = tuple[str, ...]
Tried = dict[CauseNames, list[Candidate]]
"""Sets of causes with each size of waves, the best first."""

_evidence = attrgetter("evidence")


class Information(NamedTuple):
    """What rows tell beside some waves, for s sizes of the noise; alike rows count once."""

    likelihood: Array  # (s,) [nats]
    # (s, k, k), information on the parameters that may be free, each in its standard deviation
    power: Array
    pull: Array  # (s, k), its moments

    def evidence(self, places: Indices) -> tuple[Array, Array]:
        """Evidence (s,) of freeing some parameters (p,) [nats], and their best step (p,)."""
        prior = np.eye(len(places))
        power = self.power[:, places[:, None], places] + prior
        pull = self.pull[:, places]
        root = np.linalg.cholesky(power)
        columns = np.linalg.solve(root, pull[..., None])
        half = columns[..., 0]
        gain = 0.5 * (half**2).sum(axis=1)
        sizes = np.diagonal(root, axis1=1, axis2=2)
        cost = np.log(sizes).sum(axis=1)
        evidence = self.likelihood + gain - cost
        best = int(np.argmax(evidence))
        return evidence, np.linalg.solve(power[best], pull[best])


@dataclass(frozen=True, eq=False)
class PlaceOfSet(Place):
    """Where the freed parameters of a set may be: from the reference, in their deviations."""

    residual: Array  # (n, m) [unit]
    noise: float  # of the greatest likelihood, in `Reference.sizes`


class Search:
    """Sets of causes of a log beside a reference.

    always : groups that are free in every set: a frame that no posterior tells of, a turned tool
    temper : rows that count for one
    """

    def __init__(
        self,
        system: System,
        cause: str | None,
        always: Sequence[str],
        temper: float,
    ) -> None:
        reference = system.reference
        structure = reference.structure
        self.system = system
        self.temper = temper
        groups = changeable(structure)
        self.sd = freedom(reference.body, groups, reference.forgotten)
        self.start = np.sort(indices_of(structure, always))
        singles = single_causes(structure, cause)
        allowed = np.concatenate([*singles.values()])
        self.free = np.union1d(self.start, allowed).astype(np.intp)
        self.sets = self._sets(singles)
        self.singles = [name for name in singles if name in self.sets]
        self.cost = float(np.log(max(len(self.sets), 1)))
        self.informations: dict[float, Information] = {}

    def _sets(self, singles: Mapping[str, Indices]) -> dict[str, Indices]:
        """Parameters of each cause, and of sets that belong together, that may be free."""
        reference = self.system.reference
        sets = dict(singles)
        allowed = np.concatenate([*singles.values()])
        for groups in SETS:
            indices = indices_of(reference.structure, groups)
            is_allowed = np.isin(indices, allowed)
            sets["+".join(groups)] = indices[is_allowed]
        frame = indices_of(reference.structure, FRAME)
        free_sets = {}
        for name, indices in sets.items():
            free = indices[self.sd[indices] > 0.0]
            all_free = np.union1d(free, self.start)
            if np.isin(frame, all_free).any():
                free = np.setdiff1d(free, frame_twin(reference.body))
            if not np.isin(free, self.start).all():
                free_sets[name] = free
        return free_sets

    def information(self, waves: float) -> Information:
        """What rows tell, beside some waves, of all that may be free."""
        if waves in self.informations:
            return self.informations[waves]
        x = self.system.x[:, self.free] * self.sd[self.free]
        unknown = self.system.unknown(waves)
        products = unknown.products(self.system.y, x)
        noises, likelihood = products.noises()
        some = slice(None, None, SEARCH.coarser)
        by_noise = map(products.information, noises[some].tolist())
        powers, pulls = zip(*by_noise, strict=True)
        information = Information(
            likelihood[some] / self.temper,
            np.stack(powers) / self.temper,
            np.stack(pulls) / self.temper,
        )
        # the noise of any set lies between those of all that may be free and of nothing
        most = int(np.argmax(information.likelihood))
        every = np.arange(len(self.free))
        evidence, _ = information.evidence(every)
        least = int(np.argmax(evidence))
        least = min(least, most)
        between = slice(max(least - 1, 0), most + 2)
        information = Information(*(part[between] for part in information))
        self.informations[waves] = information
        return information

    def by_waves(self, causes: tuple[str, ...]) -> list[Candidate]:
        """Return a set of causes with each size of waves, the best first."""
        parts = [self.sets[cause] for cause in causes]
        indices = np.unique(np.concatenate([self.start, *parts]))
        places = np.searchsorted(self.free, indices)
        cost = self.cost * len(causes)
        candidates = []
        for waves in WAVES:
            evidence, step = self.information(waves).evidence(places)
            value = float(evidence.max()) - cost
            candidates.append(Candidate(causes, waves, indices, value, step))
        return sorted(candidates, key=_evidence, reverse=True)

    def candidates(self) -> list[Candidate]:
        """Nothing, sets that belong together, and causes added one by one, best first."""
        nothing = self.by_waves(())
        tried: Tried = {(name,): self.by_waves((name,)) for name in self.sets}
        least = nothing[0].evidence
        beam: list[CauseNames] = [()]
        for _ in range(SEARCH.causes):
            longer = self._longer(beam, tried)
            tried |= longer
            if not longer:
                break
            best_first = sorted(
                longer.values(),
                key=lambda some: some[0].evidence,
                reverse=True,
            )
            beam = [some[0].causes for some in best_first[: SEARCH.beam]]
            best = best_first[0][0].evidence
            if best < least + SEARCH.better:
                break
            least = best
        every = chain(nothing, *tried.values())
        return sorted(every, key=_evidence, reverse=True)

    def _longer(self, beam: Sequence[CauseNames], tried: Tried) -> Tried:
        """Sets of a beam with one more cause each, with each size of waves."""
        longer: Tried = {}
        for causes in beam:
            for name in self.singles:
                if name in causes:
                    continue
                key = tuple(sorted((*causes, name)))
                if key not in longer:
                    longer[key] = tried.get(key) or self.by_waves(key)
        return longer

    def explanation_of(self, candidate: Candidate) -> Explanation:
        """Fit a set by damped Gauss-Newton steps: its noise by likelihood, its evidence."""
        best = climb(
            lambda normals: self._place(candidate, normals),
            candidate.step,
            most=SEARCH.steps,
            enough=SEARCH.enough,
        )
        return self._explanation(candidate, best)

    def _place(self, candidate: Candidate, normals: Array) -> PlaceOfSet | None:
        """Compare the rows with a set at its parameters (p,), None without a prediction."""
        reference = self.system.reference
        free = candidate.indices
        sd = self.sd[free]
        step = np.zeros(reference.structure.size)
        step[free] = sd * normals
        beta = reference.structure.retract(reference.beta, step)
        residual, columns = self.system.residual(beta, free)
        if not np.isfinite(residual).all():
            return None
        unknown = self.system.unknown(candidate.waves)
        y = self.system.whiten(residual)
        products = unknown.products(y, columns * sd)
        noise = products.most_likely_noise()
        likelihood = float(products.likelihood(noise)[0])
        power, pull = products.information(noise)
        return PlaceOfSet(
            normals=normals,
            beta=beta,
            fit=likelihood / self.temper - 0.5 * float(normals @ normals),
            gradient=pull / self.temper - normals,
            precision=power / self.temper + np.eye(len(normals)),
            residual=residual,
            noise=noise,
        )

    def _explanation(
        self, candidate: Candidate, place: PlaceOfSet
    ) -> Explanation:
        """The set of causes at the place of its best fit, with its evidence by Laplace."""
        free = candidate.indices
        sd = np.zeros(len(place.beta))
        sd[free] = self.sd[free]
        precision = Factor(place.precision)
        deviation = np.zeros(len(place.beta))
        deviation[free] = sd[free] * np.sqrt(np.diag(precision.inverse()))
        volume = 0.5 * precision.log_determinant()
        cost = self.cost * len(candidate.causes)
        return Explanation(
            causes=candidate.causes,
            waves=candidate.waves,
            reference=self.system.reference,
            indices=free,
            beta=place.beta,
            sd=sd,
            evidence=place.fit - volume - cost,
            temper=self.temper,
            deviation=deviation,
            noise=place.noise,
            residual=place.residual,
        )

    def explanations(self, *, calm: bool) -> list[Explanation]:
        """Fit the best sets; set the system up again where that leads far.

        calm : whether only the sizes of the log's own residual are compared
        """
        fits = [
            self.explanation_of(candidate) for candidate in self.by_waves(())
        ]
        causes: tuple[str, ...] | None = None
        for _ in range(0 if calm else SEARCH.rounds):
            candidates = self.candidates()
            promise = candidates[0].evidence
            for candidate in candidates[: SEARCH.fits]:
                if candidate.evidence > promise - SEARCH.near:
                    fits.append(self.explanation_of(candidate))
            fits.sort(key=_evidence, reverse=True)
            near = abs(fits[0].evidence - promise) < MARGIN
            if near or causes == fits[0].causes:
                break
            causes = fits[0].causes
            self.system = self.system.again(fits[0].beta)
            self.informations = {}
        alone = {(fit.causes, fit.waves): fit for fit in reversed(fits)}
        return list(alone.values())


def explain(
    systems: Sequence[System],
    cause: str | None,
    *,
    temper: float,
    calm: bool,
    turned: Sequence[str] = (),
) -> tuple[Explanation, ...]:
    """Return sets of causes with their evidence, the best first.

    systems : the log beside the belief as it was, and in the frame that fits the log best where
        that is far
    temper : rows that count for one
    calm : whether nothing changed
    turned : groups that changed for sure, as orientations show: the tool that is turned has moved
    """
    explanations: list[Explanation] = []
    for system in systems:
        always = turned
        if system.reference.is_fitted:
            always = (*FRAME, *turned)
        search = Search(system, cause, always, temper)
        explanations += search.explanations(calm=calm)
    return tuple(sorted(explanations, key=_evidence, reverse=True))
