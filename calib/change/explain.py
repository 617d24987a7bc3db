"""Explaining: which sets of causes account for a log, each with its evidence.

The evidence of a set whose causes free parameters of standard deviations sd is Laplace's::

    log p(y | causes) = log p(y | d) + log p(d) - 1/2 log |A| - cost,    A = I + sd X' C^-1 X sd

at the best d / sd.  The likelihood is raised to the power 1 / correlation time of the observations:
rows that resemble their neighbours count for less than their number.  Each cause pays the logarithm
of how many there are.

`Search.best_candidates` adds causes one by one in the linear system, `Search.explanation_of` fits
the best sets to convergence, and where that leads far the system is linearised again there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain, product
from typing import NamedTuple

import numpy as np

from ..body.covariance import Factor
from ..body.parameters import Indices
from ..common.arrays import Array
from .causes import (
    FRAME,
    SETS,
    frame_twin,
    indices_of,
)
from .explanation import Explanation, Place, climb
from .system import System

# Nats by which a change must be better than none, and within which a fit is as good as promised
MARGIN = 5.0


@dataclass(frozen=True)
class SearchSettings:
    """How causes are searched."""

    # most causes in a set
    causes: int = 3
    # sets of causes to which further ones are added
    beam: int = 4
    # nats by which one more cause must better the evidence: without it waves of 8 mrad in a corner
    # were an offset and a gain
    nats_better: float = 1.0
    # nats by which two causes must better it of which neither does alone, as a joint's zero and its
    # gain that nearly cancel in the log's part of the range: waves of 8 mrad in a corner gain 6.2
    nats_of_pair: float = 10.0
    # most times that sets are compared, each after a new linearisation
    rounds: int = 3
    # most explanations of a round that are fitted to convergence
    fits: int = 8
    # nats from the best within which explanations are fitted
    nats_near: float = 10.0
    # sizes of the noise from one that is compared to the next: sets share it nearly
    noise_stride: int = 3


SEARCH = SearchSettings()


class Candidate(NamedTuple):
    """A set of causes in the linear system, p of whose parameters are free."""

    causes: tuple[str, ...]
    wave_size: float  # of `Reference.wave_sizes`
    indices: Indices  # (p,), parameters that are free
    evidence: float  # [nats]
    normals: Array  # (p,), their best changes over the standard deviations by which they are free


def _order(candidate: Candidate | Explanation) -> tuple[float, tuple[str, ...]]:
    """What sorts sets of causes: the greatest evidence first."""
    return -candidate.evidence, candidate.causes


class Information(NamedTuple):
    """Information of rows about k parameters over their sds, for l sizes of the noise.

    All is divided by the correlation_time.
    """

    likelihood: Array  # (l,), where none of them changed [nats]
    matrices: Array  # (l, k, k), sd X' C^-1 X sd
    vectors: Array  # (l, k), sd X' C^-1 y

    def evidence(self, places: Indices) -> tuple[Array, Array]:
        """Evidence (l,) of freeing p of the parameters [nats], and their best changes (p,).

        log p(y) = likelihood + b' A^-1 b / 2 - log |A| / 2, with A = I + matrix, b = vector; the
        changes A^-1 b are those of the best size of the noise.
        """
        a = self.matrices[:, places[:, None], places] + np.eye(len(places))
        b = self.vectors[:, places]
        root = np.linalg.cholesky(a)
        white = np.linalg.solve(root, b[..., None])[..., 0]
        gain = 0.5 * (white**2).sum(axis=1)
        diagonal = np.diagonal(root, axis1=1, axis2=2)
        half_determinant = np.log(diagonal).sum(axis=1)
        evidence = self.likelihood + gain - half_determinant
        best = int(np.argmax(evidence))
        return evidence, np.linalg.solve(a[best], b[best])


@dataclass(frozen=True, eq=False)
class PlaceOfSet(Place):
    """Changes of the freed parameters of a set, over their standard deviations."""

    residual: Array  # (n, m) [unit]
    noise: float  # of the greatest likelihood, in `Reference.sizes`


class Search:
    """Sets of causes of a log against a reference.

    free_groups : those free in every set: a frame that was fitted to the log, a turned tool
    sd : (d,), by which the parameters may have changed
    beta : (d,), parameters at which the system is linear
    always_free : parameters of `free_groups`
    free : those that are free in any set
    """

    def __init__(
        self,
        system: System,
        cause: str | None,
        free_groups: Sequence[str],
    ) -> None:
        reference = system.reference
        structure = reference.structure
        self.system = system
        self.correlation_time = system.observations.correlation_time
        self.sd = reference.sd_if_changed()
        self.always_free = np.sort(indices_of(structure, free_groups))
        singles = system.single_causes(cause)
        indices = [self.always_free, *singles.values()]
        self.free = np.unique(np.concatenate(indices))
        self.cause_sets = self._cause_sets(singles)
        self.single_names = [
            name for name in singles if name in self.cause_sets
        ]
        self.cost = float(np.log(max(len(self.cause_sets), 1)))
        self.linearise(reference.beta)

    def _cause_sets(self, singles: Mapping[str, Indices]) -> dict[str, Indices]:
        """Parameters of each cause, and of sets that belong together, that may be free."""
        reference = self.system.reference
        sets = dict(singles)
        for groups in SETS:
            indices = indices_of(reference.structure, groups)
            sets["+".join(groups)] = np.intersect1d(indices, self.free)
        frame = indices_of(reference.structure, FRAME)
        free_sets = {}
        for name, indices in sets.items():
            free = indices[self.sd[indices] > 0.0]
            all_free = np.union1d(free, self.always_free)
            if np.isin(frame, all_free).any():
                free = np.setdiff1d(free, frame_twin(reference.body))
            if not np.isin(free, self.always_free).all():
                free_sets[name] = free
        return free_sets

    def linearise(self, beta: Array) -> None:
        """Compare sets of causes in the system as it is linear at parameters (d,)."""
        self.beta = beta
        self.information = cache(self._information)

    def _information(self, wave_size: float) -> Information:
        """Information of rows about all that may be free, given waves of a size."""
        residual, columns = self.system.residual(self.beta, self.free)
        change = (self.beta - self.system.reference.beta)[self.free]
        y = self.system.whiten(residual) + columns @ change
        nuisance = self.system.nuisance(wave_size)
        statistics = nuisance.statistics(y, columns * self.sd[self.free])
        noises, likelihood = statistics.noises()
        sparse = slice(None, None, SEARCH.noise_stride)
        by_noise = map(statistics.information, noises[sparse].tolist())
        matrices, vectors = zip(*by_noise, strict=True)
        return Information(
            likelihood[sparse] / self.correlation_time,
            np.stack(matrices) / self.correlation_time,
            np.stack(vectors) / self.correlation_time,
        )

    def candidates_of(self, causes: tuple[str, ...]) -> list[Candidate]:
        """Return a set of causes with each size of waves, the best first."""
        parts = [self.cause_sets[cause] for cause in causes]
        indices = np.unique(np.concatenate([self.always_free, *parts]))
        places = np.searchsorted(self.free, indices)
        cost = self.cost * len(causes)
        candidates = []
        for wave_size in self.system.reference.wave_sizes:
            evidence, normals = self.information(wave_size).evidence(places)
            best = float(evidence.max()) - cost
            candidates.append(
                Candidate(causes, wave_size, indices, best, normals)
            )
        return sorted(candidates, key=_order)

    def fits(self, *, calm: bool) -> Iterable[Explanation]:
        """Fits of nothing, and unless all is `calm` of the best sets.

        Where the best fit is not as it was promised, sets are compared again as they are there.
        """
        fits: dict[tuple[tuple[str, ...], float], Explanation] = {}
        candidates = self.candidates_of(())
        for _ in range(SEARCH.rounds):
            if not calm:
                candidates += self.best_candidates()
            for candidate in candidates:
                key = candidate.causes, candidate.wave_size
                if key not in fits:
                    fits[key] = self.explanation_of(candidate)
            best = min(fits.values(), key=_order)
            promise = min(candidates, key=_order)
            if calm or abs(best.evidence - promise.evidence) < MARGIN:
                break
            self.linearise(best.beta)
            candidates = []
        return fits.values()

    def best_candidates(self) -> list[Candidate]:
        """Sets that belong together, and causes added one by one: those near the best."""
        best = self.candidates_of(())[0]
        tried = [best]
        for name in self.cause_sets.keys() - self.single_names:
            tried += self.candidates_of((name,))
        beam = [best]
        for count in range(1, SEARCH.causes + 1):
            longer = {
                tuple(sorted((*shorter.causes, name)))
                for shorter, name in product(beam, self.single_names)
                if name not in shorter.causes
            }
            sets = [self.candidates_of(causes) for causes in longer]
            beam = sorted((first for first, *_ in sets), key=_order)
            beam = beam[: SEARCH.beam]
            # neither of two causes helps alone, but both together may
            is_pair = count > 1 and not best.causes
            gain = SEARCH.nats_of_pair if is_pair else SEARCH.nats_better
            is_better = bool(beam) and beam[0].evidence >= best.evidence + gain
            if is_pair and not is_better:
                break
            tried += chain(*sets)
            if is_better:
                best = beam[0]
            elif best.causes:
                break
        tried.sort(key=_order)
        least = tried[0].evidence - SEARCH.nats_near
        near = [candidate for candidate in tried if candidate.evidence > least]
        return [
            candidate for candidate in near[: SEARCH.fits] if candidate.causes
        ]

    def explanation_of(self, candidate: Candidate) -> Explanation:
        """Fit a set by damped Gauss-Newton steps, its evidence by Laplace."""
        place = climb(partial(self._place, candidate), candidate.normals)
        free = candidate.indices
        sd = np.zeros(len(place.beta))
        sd[free] = self.sd[free]
        precision = Factor(place.precision)
        deviation = sd.copy()
        deviation[free] *= np.sqrt(np.diag(precision.inverse()))
        half_determinant = 0.5 * precision.log_determinant()
        cost = self.cost * len(candidate.causes)
        return Explanation(
            causes=candidate.causes,
            wave_size=candidate.wave_size,
            reference=self.system.reference,
            indices=free,
            beta=place.beta,
            sd=sd,
            evidence=place.fit - half_determinant - cost,
            deviation=deviation,
            noise=place.noise,
            residual=self.system.observations.about_sockets(place.residual),
        )

    def _place(self, candidate: Candidate, normals: Array) -> PlaceOfSet | None:
        """Compare the rows with changes (p,) of a set's parameters, None without a prediction.

        The posterior is log p(y | d) / correlation time - normals' normals / 2, d = sd * normals.
        """
        free = candidate.indices
        sd = self.sd[free]
        beta, residual, columns = self.system.after_step(free, sd * normals)
        if not np.isfinite(residual).all():
            return None
        y = self.system.whiten(residual)
        nuisance = self.system.nuisance(candidate.wave_size)
        statistics = nuisance.statistics(y, columns * sd)
        noise = statistics.most_likely_noise()
        likelihood = float(statistics.likelihood(noise)[0])
        matrix, vector = statistics.information(noise)
        return PlaceOfSet(
            normals=normals,
            beta=beta,
            fit=likelihood / self.correlation_time
            - 0.5 * float(normals @ normals),
            gradient=vector / self.correlation_time - normals,
            precision=matrix / self.correlation_time + np.eye(len(normals)),
            residual=residual,
            noise=noise,
        )


def explain(
    systems: Sequence[System],
    cause: str | None,
    *,
    calm: bool,
    certain_groups: Sequence[str] = (),
) -> tuple[Explanation, ...]:
    """Return sets of causes with their evidence, the best first.

    systems : the log against the old belief, and in the frame that fits the log best where
        that is far
    calm : whether no test fired: the causes are not searched then
    certain_groups : those that changed for sure: orientations show that the tool has moved
    """
    explanations: list[Explanation] = []
    for system in systems:
        free_groups = certain_groups
        if system.reference.is_fitted:
            free_groups = (*FRAME, *certain_groups)
        search = Search(system, cause, free_groups)
        explanations += search.fits(calm=calm)
    return tuple(sorted(explanations, key=_order))
