"""Explaining: which sets of causes account for a log, each with its evidence.

The log evidence of a set whose causes free parameters of standard deviations sd is Laplace's::

    log p(y | causes) = log p(y | d) + log p(d) - 1/2 log |A| - cost,    A = I + sd X' C^-1 X sd

at the best d / sd.  The likelihood is raised to the power 1 / correlation time of the observations:
rows that resemble their neighbours count for less than their number.  Each cause costs the
logarithm of the number of causes.

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
from .causes import FRAME, SETS, frame_twin, indices_of
from .explanation import Explanation, Iterate, climb
from .system import System

# Nats that decide: a change gains as many over none, and two values within them count as equal
MARGIN = 5.0


@dataclass(frozen=True)
class SearchSettings:
    """How causes are searched."""

    # most causes in a set
    causes: int = 3
    # sets of causes to which further ones are added
    beam: int = 4
    # nats that one more cause must gain: without it waves of 8 mrad in a corner were an offset and
    # a gain
    nats_better: float = 1.0
    # nats that two causes must gain together where neither gains alone, as a joint's zero and its
    # gain that nearly cancel in the log's part of the range: waves of 8 mrad in a corner gain 6.2
    nats_of_pair: float = 10.0
    # most rounds of comparing sets, each with a new linearisation
    rounds: int = 3
    # most explanations of a round that are fitted to convergence
    fits: int = 8
    # nats from the best within which explanations are fitted
    nats_near: float = 10.0
    # every third size of the noise is compared: the best one hardly depends on the set
    noise_stride: int = 3


SEARCH = SearchSettings()


class Candidate(NamedTuple):
    """A set of causes in the linear system, p of whose parameters are free."""

    causes: tuple[str, ...]
    wave_size: float  # of `Reference.wave_sizes`
    indices: Indices  # (p,), parameters that are free
    log_evidence: float  # [nats]
    normals: Array  # (p,), their best changes over their standard deviations `Search.sd`


def _sort_key(
    candidate: Candidate | Explanation,
) -> tuple[float, tuple[str, ...]]:
    """Key by which sets of causes are sorted: the greatest evidence comes first."""
    return -candidate.log_evidence, candidate.causes


class Information(NamedTuple):
    """Information of rows about k parameters over their sds, for l sizes of the noise.

    All of it is divided by the rows' correlation time.
    """

    likelihood: Array  # (l,), where none of the parameters changed [nats]
    matrices: Array  # (l, k, k), sd X' C^-1 X sd
    vectors: Array  # (l, k), sd X' C^-1 y

    def log_evidence(self, indices: Indices) -> tuple[Array, Array]:
        """Log evidence (l,) of freeing p of the parameters [nats], and their best changes (p,).

        log p(y) = likelihood + b' A^-1 b / 2 - log |A| / 2, with A = I + matrix, b = vector; the
        changes A^-1 b are those of the best size of the noise.
        """
        count = len(indices)
        a = self.matrices[:, indices[:, None], indices] + np.eye(count)
        b = self.vectors[:, indices]
        root = np.linalg.cholesky(a)
        white = np.linalg.solve(root, b[..., None])[..., 0]
        gain = 0.5 * (white**2).sum(axis=1)
        diagonal = np.diagonal(root, axis1=1, axis2=2)
        half_determinant = np.log(diagonal).sum(axis=1)
        log_evidence = self.likelihood + gain - half_determinant
        best = int(np.argmax(log_evidence))
        return log_evidence, np.linalg.solve(a[best], b[best])


@dataclass(frozen=True, eq=False)
class SetIterate(Iterate):
    """Changes of a set's free parameters, over their standard deviations."""

    residual: Array  # (n, m) [unit]
    noise: float  # of the greatest likelihood, in `Reference.expected_noise`


class Search:
    """Sets of causes of a log against a reference.

    free_groups : groups free in every set: a frame that was fitted to the log, a turned tool
    sd : (d,), by which the parameters may have changed
    beta : (d,), parameters about which the system is linearised
    always_free : parameters of `free_groups`
    free : (k,), parameters that are free in some set
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
        """Free parameters of each single cause, and of each set in `SETS`."""
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
        """Linearise the system about parameters (d,)."""
        self.beta = beta
        self.information = cache(self._information)

    def _information(self, wave_size: float) -> Information:
        """Information of the rows about all of `free`, given waves of a size."""
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
        among_free = np.searchsorted(self.free, indices)
        cost = self.cost * len(causes)
        candidates = []
        for wave_size in self.system.reference.wave_sizes:
            information = self.information(wave_size)
            log_evidence, normals = information.log_evidence(among_free)
            best = float(log_evidence.max()) - cost
            candidates.append(
                Candidate(causes, wave_size, indices, best, normals)
            )
        return sorted(candidates, key=_sort_key)

    def fits(self, *, calm: bool) -> Iterable[Explanation]:
        """Fit no cause and, unless all is `calm`, the best sets of causes.

        Where the best fit is not as good as its linear system promised, the system is linearised
        there and sets are compared again.
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
            best = min(fits.values(), key=_sort_key)
            promise = min(candidates, key=_sort_key)
            if calm or abs(best.log_evidence - promise.log_evidence) < MARGIN:
                break
            self.linearise(best.beta)
            candidates = []
        return fits.values()

    def best_candidates(self) -> list[Candidate]:
        """The best of the sets in `SETS` and of those that grow cause by cause."""
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
            beam = sorted((first for first, *_ in sets), key=_sort_key)
            beam = beam[: SEARCH.beam]
            # neither of two causes helps alone, but both together may
            is_pair = count > 1 and not best.causes
            gain = SEARCH.nats_of_pair if is_pair else SEARCH.nats_better
            least = best.log_evidence + gain
            is_better = bool(beam) and beam[0].log_evidence >= least
            if is_pair and not is_better:
                break
            tried += chain(*sets)
            if is_better:
                best = beam[0]
            elif best.causes:
                break
        tried.sort(key=_sort_key)
        least = tried[0].log_evidence - SEARCH.nats_near
        near = [tested for tested in tried if tested.log_evidence > least]
        return [tested for tested in near[: SEARCH.fits] if tested.causes]

    def explanation_of(self, candidate: Candidate) -> Explanation:
        """Fit a set by damped Gauss-Newton steps; its log evidence is Laplace's."""
        iterate = climb(partial(self._iterate, candidate), candidate.normals)
        free = candidate.indices
        sd = np.zeros(len(iterate.beta))
        sd[free] = self.sd[free]
        precision = Factor(iterate.precision)
        deviation = sd.copy()
        deviation[free] *= np.sqrt(np.diag(precision.inverse()))
        half_determinant = 0.5 * precision.log_determinant()
        cost = self.cost * len(candidate.causes)
        return Explanation(
            causes=candidate.causes,
            wave_size=candidate.wave_size,
            reference=self.system.reference,
            indices=free,
            beta=iterate.beta,
            sd=sd,
            log_evidence=iterate.fit - half_determinant - cost,
            deviation=deviation,
            noise=iterate.noise,
            residual=self.system.observations.about_sockets(iterate.residual),
        )

    def _iterate(
        self, candidate: Candidate, normals: Array
    ) -> SetIterate | None:
        """The iterate at changes (p,) of a set's parameters, None without a prediction.

        log posterior = log p(y | d) / correlation time - normals' normals / 2,  d = sd * normals
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
        return SetIterate(
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

    systems : of the log in the frame of the old belief, and in the frame fitted to the log if that
        is far from it; one or both of them
    calm : whether no test fired, so that causes are not searched
    certain_groups : groups that certainly changed, such as the tool that orientations show to move
    """
    explanations: list[Explanation] = []
    for system in systems:
        free_groups = certain_groups
        if system.reference.is_fitted:
            free_groups = (*FRAME, *certain_groups)
        search = Search(system, cause, free_groups)
        explanations += search.fits(calm=calm)
    return tuple(sorted(explanations, key=_sort_key))
