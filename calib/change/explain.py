"""Explaining: which sets of causes account for a log, each with its evidence.

The evidence is Laplace's, with the likelihood raised to the power 1 / temper: rows that resemble
their neighbours count for less than their number.  Causes are added one by one, each of which pays
the logarithm of how many there are; the best sets are fitted to convergence, and where that leads
far the system is set up again there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from ..body.normal import Factor
from ..body.parameters import Indices
from ..body.settings import NATS
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
from .frame import Reference
from .settings import (
    CREEP,
    MARGIN,
    OWN,
    Level,
)
from .system import Products, System


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
    # Gauss-Newton steps at most, and what is left of one that does not better the fit
    steps: int = 12
    shorter: float = 0.3
    # twice the nats by which a step must promise to better the fit
    nothing_left: float = 1e-2


SEARCH = SearchSettings()


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes that accounts for a log, fitted to it."""

    causes: tuple[str, ...]
    level: Level
    reference: Reference
    indices: Indices  # parameters that are free
    beta: Array  # (d,), parameters of the greatest evidence
    sd: Array  # (d,), standard deviations by which they were free to change
    evidence: float  # logarithm of the tempered evidence [nats]
    temper: float  # rows that count for one
    # (d,), posterior standard deviations of those that are free, zero elsewhere
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
    def is_no_change(self) -> bool:
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


class Candidate(NamedTuple):
    """A set of causes in the linear system."""

    causes: tuple[str, ...]
    level: Level
    indices: Indices  # parameters that are free
    evidence: float  # [nats]
    step: Array  # of the parameters, in the standard deviations by which they are free


_evidence = attrgetter("evidence")


class Information(NamedTuple):
    """What rows tell at one level, for s sizes of the noise; rows that are alike count once."""

    likelihood: Array  # (s,) [nats]
    # (s, k, k), information on the parameters that may be free, each in its standard deviation
    power: Array
    pull: Array  # (s, k), its moments

    def evidence(self, places: Indices) -> tuple[Array, Array]:
        """Evidence (s,) of freeing some parameters (p,) [nats], and their best step (p,)."""
        power = self.power[:, places[:, None], places]
        power = power + np.eye(len(places))
        pull = self.pull[:, places]
        root = np.linalg.cholesky(power)
        half = np.linalg.solve(root, pull[..., None])[..., 0]
        sizes = np.diagonal(root, axis1=1, axis2=2)
        gain = 0.5 * (half**2).sum(axis=1)
        evidence = self.likelihood + gain - np.log(sizes).sum(axis=1)
        best = int(np.argmax(evidence))
        return evidence, np.linalg.solve(power[best], pull[best])


@dataclass(frozen=True, eq=False)
class Place:
    """Where the freed parameters of a set may be, and how the rows lie there."""

    moved: Array  # (p,), from the reference, in the standard deviations by which they are free
    beta: Array  # (d,), all parameters
    residual: Array  # (n, m) [unit]
    products: Products
    noise: float  # of the greatest likelihood, in `Reference.sizes`
    temper: float  # rows that count for one

    @cached_property
    def fit(self) -> float:
        """Logarithm of the tempered posterior [nats]."""
        likelihood = float(self.products.likelihood(self.noise)[0])
        prior = 0.5 * float((self.moved**2).sum())
        return likelihood / self.temper - prior

    @cached_property
    def _information(self) -> tuple[Array, Array]:
        return self.products.information(self.noise)

    @cached_property
    def precision(self) -> Factor:
        """Of the posterior, (p, p)."""
        power = self._information[0] / self.temper
        return Factor(power + np.eye(len(power)))

    @property
    def gradient(self) -> Array:
        """Of the logarithm of the posterior, (p,)."""
        return self._information[1] / self.temper - self.moved


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
        together = {}
        for some in SETS:
            indices = indices_of(structure, some)
            together["+".join(some)] = indices[np.isin(indices, allowed)]
        self.sets = {}
        frame = indices_of(structure, FRAME)
        for name, indices in (singles | together).items():
            free = indices[self.sd[indices] > 0.0]
            if np.isin(frame, [*free, *self.start]).any():
                free = np.setdiff1d(free, frame_twin(reference.body))
            if not np.isin(free, self.start).all():
                self.sets[name] = free
        self.singles = [name for name in singles if name in self.sets]
        self.cost = float(np.log(max(len(self.sets), 1)))
        self.free = np.union1d(self.start, allowed).astype(np.intp)
        self.informations: dict[Level, Information] = {}

    def information(self, level: Level) -> Information:
        """What rows tell at a level of all that may be free."""
        if level in self.informations:
            return self.informations[level]
        x = self.system.x[:, self.free] * self.sd[self.free]
        unknown = self.system.unknown(level)
        products = unknown.products(self.system.y, x)
        noises, likelihood = products.noises()
        rows = [
            products.information(float(noise))
            for noise in noises[:: SEARCH.coarser]
        ]
        information = Information(
            likelihood[:: SEARCH.coarser] / self.temper,
            np.stack([power for power, _ in rows]) / self.temper,
            np.stack([pull for _, pull in rows]) / self.temper,
        )
        # the noise of any set lies between those of all that may be free and of nothing
        most = int(np.argmax(information.likelihood))
        every = np.arange(len(self.free))
        evidence, _ = information.evidence(every)
        least = min(int(np.argmax(evidence)), most)
        between = slice(max(least - 1, 0), most + 2)
        information = Information(*(part[between] for part in information))
        self.informations[level] = information
        return information

    def by_level(self, causes: tuple[str, ...]) -> list[Candidate]:
        """Return a set of causes at each level, the best first."""
        parts = [self.sets[cause] for cause in causes]
        indices = np.unique(np.concatenate([self.start, *parts]))
        places = np.searchsorted(self.free, indices)
        cost = self.cost * len(causes)
        candidates = []
        for level in OWN:
            evidence, step = self.information(level).evidence(places)
            value = float(evidence.max()) - cost
            candidates.append(Candidate(causes, level, indices, value, step))
        return sorted(candidates, key=_evidence, reverse=True)

    def candidates(self) -> list[Candidate]:
        """Return nothing, sets that belong together, and causes added one by one, best first."""
        nothing = self.by_level(())
        tried: dict[tuple[str, ...], list[Candidate]] = {}
        for name in self.sets:
            tried[(name,)] = self.by_level((name,))
        best = nothing[0].evidence
        beam: list[tuple[str, ...]] = [()]
        for _ in range(SEARCH.causes):
            longer = {}
            for causes in beam:
                for name in self.singles:
                    key = tuple(sorted({*causes, name}))
                    if len(key) > len(causes) and key not in longer:
                        longer[key] = tried.get(key) or self.by_level(key)
            tried |= longer
            beam = sorted(longer, key=lambda key: -longer[key][0].evidence)
            beam = beam[: SEARCH.beam]
            if not beam or longer[beam[0]][0].evidence < best + SEARCH.better:
                break
            best = longer[beam[0]][0].evidence
        every = chain(nothing, *tried.values())
        return sorted(every, key=_evidence, reverse=True)

    def explanation_of(self, candidate: Candidate) -> Explanation:
        """Fit a set by damped Gauss-Newton steps: its noise by likelihood, its evidence."""
        best = None
        moved = np.zeros(len(candidate.indices))
        step = candidate.step
        for _ in range(SEARCH.steps):
            place = self._place(candidate, moved + step)
            if place is None or not place.fit > (best.fit if best else -np.inf):
                step = SEARCH.shorter * step
                continue
            best = place
            moved = place.moved
            lead = place.gradient
            step = place.precision.solve(lead)
            if float(lead @ step) < SEARCH.nothing_left:
                break
        if best is None:
            raise np.linalg.LinAlgError("no prediction is a number")
        return self._explanation(candidate, best)

    def _place(self, candidate: Candidate, moved: Array) -> Place | None:
        """Compare the rows with a set whose parameters moved so far, None without a prediction."""
        reference = self.system.reference
        free = candidate.indices
        sd = self.sd[free]
        full = np.zeros(reference.structure.size)
        full[free] = sd * moved
        beta = reference.structure.retract(reference.beta, full)
        residual, columns = self.system.residual(beta, free)
        if not np.isfinite(residual).all():
            return None
        unknown = self.system.unknown(candidate.level)
        products = unknown.products(self.system.whiten(residual), columns * sd)
        noise = products.most_likely_noise()
        return Place(moved, beta, residual, products, noise, self.temper)

    def _explanation(self, candidate: Candidate, place: Place) -> Explanation:
        """The set of causes at the place of its best fit, with its evidence by Laplace."""
        free = candidate.indices
        sd = np.zeros(len(place.beta))
        sd[free] = self.sd[free]
        precision = place.precision
        variance = np.diag(precision.inverse())
        deviation = np.zeros(len(place.beta))
        deviation[free] = sd[free] * np.sqrt(variance)
        cost = self.cost * len(candidate.causes)
        return Explanation(
            causes=candidate.causes,
            level=candidate.level,
            reference=self.system.reference,
            indices=free,
            beta=place.beta,
            sd=sd,
            evidence=place.fit - 0.5 * precision.log_determinant() - cost,
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
            self.explanation_of(candidate) for candidate in self.by_level(())
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
        alone = {(fit.causes, fit.level): fit for fit in reversed(fits)}
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
        reference = system.reference
        always = turned
        if reference.is_fitted:
            always = (*FRAME, *turned)
        search = Search(system, cause, always, temper)
        explanations += search.explanations(calm=calm)
    return tuple(sorted(explanations, key=_evidence, reverse=True))


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
    fewest = min(len(one.indices) for one in some)
    simple = [one for one in some if len(one.indices) == fewest]
    return max(simple, key=_evidence)
