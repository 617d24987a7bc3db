"""Significance: F tests of groups of parameters, each given what an unchanged arm may show.

For the columns X of a group and C = K + s^2 I::

    d = (X' C^-1 X)^-1 X' C^-1 y,    y' C^-1 X d / k ~ F(k, f)    where nothing changed

k are the directions that the rows determine, f the degrees of freedom that they leave to the noise
(`Statistics.noise_freedom`).  The noise s is the most likely one where all groups may have
changed, or where one encoder is noisy: as it is estimated, a group has the chance of an F test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.parameters import Indices
from ..body.structure import Structure
from ..common.arrays import Array, Index
from .causes import indices_of
from .frame import Reference
from .noise import (
    FALSE_ALARM,
    NoiseFit,
    f_chance,
    score_of,
)
from .rows import LogRows
from .system import (
    CREEP_SHARE,
    NoisyJoint,
    Nuisance,
    Statistics,
)


@dataclass(frozen=True)
class SignificanceSettings:
    """When something is no chance."""

    # share of logs in which the smallest change that is reported would be found
    power: float = 0.9
    # times the noise of a change that rows have to be able to show: 10 rows of two joints, which
    # hardly tell the noise, show those of 11 to 37 times on, 12 rows 4 times
    large: float = 10.0
    # statistic beyond which no size of a change is computed
    largest: float = 1e8


SIGNIFICANCE = SignificanceSettings()

# Least time over which rows err together that is no noise [rows]
LAGGING = 3.0
LASTING = 10  # rows over which noise may last
# Share of rows beyond a 95 % bound that fails for sure: halves of A and C have 13 % at most
BEYOND = 0.2
# Share of them from which errors that repeat are a change: pieces of unchanged halves have .25 at
# most, waves of 60 cycles and 3 mrad .47
CONTRADICTED = 1.0 / 3.0
NOISE = "a noisier sensor or encoder, "
NO_NOISE = "no noise, wrong rows, another sensor's or an unknown change, "
SHOWN = {"scale": "sensor scale", "tilt": "sensor tilt"}
"""Groups whose names do not show that they are the sensor's."""


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``
    # chance of such rows where nothing changed, after Bonferroni
    p_value: float
    statistic: float = 0.0  # twice the gain in log likelihood
    freedom: int = 1  # degrees of freedom: directions that the rows determine
    # [unit], root mean square displacement, over the learned range, of the smallest change of the
    # parameter that these rows show best which they would show nine times in ten
    smallest: float = 0.0

    @property
    def score(self) -> float:
        """Logarithm of the p-value over that of `FALSE_ALARM`: above 1 it fired."""
        return score_of(self.p_value)


@dataclass(frozen=True)
class GroupTests:
    """All groups of one log."""

    groups: tuple[GroupTest, ...]
    # [unit], standard deviation per axis of what no group explains
    noise: float
    usual: float  # [unit], what the belief expected
    # a joint whose encoder is noisy, its noise [rad or m]
    noisy: NoisyJoint | None = None
    # whether the scatter is larger than usual, and that is no chance
    noisier: bool = False
    # whether a joint has a wave, as it may be of an arm that has not changed
    wavy: bool = False

    @property
    def score(self) -> float:
        """Largest score of a group."""
        return max((group.score for group in self.groups), default=0.0)

    @property
    def _sizes(self) -> list[float]:
        return [g.smallest for g in self.groups if g.smallest > 0.0]

    @property
    def too_few(self) -> bool:
        """Whether the rows could not show a large change of any group."""
        least = min(self._sizes, default=np.inf)
        return least > SIGNIFICANCE.large * max(self.noise, self.usual)

    @property
    def smallest(self) -> float:
        """Displacement [unit] that any single cause would have shown."""
        return max(self._sizes, default=np.inf)


def groups_of(
    structure: Structure, causes: Mapping[str, Indices]
) -> dict[str, Indices]:
    """Return the groups that are tested: each cause alone and with the sensor, all geometry."""
    frame = causes.get("sensor", np.zeros(0, np.intp))
    groups: dict[str, Indices] = {}
    for name, indices in causes.items():
        groups[name] = indices
        if not np.isin(frame, indices).all():
            groups[f"{name} and sensor"] = np.concatenate([indices, frame])
    geometry = indices_of(structure, ("offset", "length", "gain", "elastic"))
    groups["geometry"] = np.concatenate([geometry, frame])
    return groups


@dataclass(frozen=True)
class FTests:
    """F tests of columns against the noise s and K."""

    statistics: Statistics
    noise: float  # s
    # degrees of freedom: directions of the rows that determine the noise
    noise_freedom: float
    correlation_time: float  # of the rows
    count: int  # tests, of which one may fire by chance

    def of_groups(
        self, groups: dict[str, Indices], moves: Array
    ) -> list[GroupTest]:
        """Test groups of the columns; those that the rows do not determine are left out.

        moves : (k,), root mean square displacement by one of each parameter [unit]
        """
        matrix, vector = self.statistics.information(self.noise)
        precision = np.diag(matrix)
        tests = []
        for name, indices in groups.items():
            if precision[indices].max() > 0.0:  # a tracker has no lens
                block = matrix[np.ix_(indices, indices)]
                test = self._of_group(
                    name, block, vector[indices], moves[indices]
                )
                tests.append(test)
        return tests

    def _of_group(
        self, name: str, matrix: Array, vector: Array, moves: Array
    ) -> GroupTest:
        """Test parameters (k,) by their information matrix (k, k) and vector (k,).

        moves : (k,), root mean square displacement by one of each [unit]
        """
        # directions S^-1 V that the rows determine, of the matrix S V diag(values) V' S
        precision = np.diag(matrix)
        scale = np.sqrt(np.maximum(precision, 1e-300))
        values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale)
        clear = values > 1e-9 * values[-1]
        values = values[clear]
        directions = vectors[:, clear] / scale[:, None]
        along = directions.T @ vector
        statistic = float((along**2 / values).sum()) / self.correlation_time
        freedom = len(values)
        chance = f_chance(statistic, freedom, self.noise_freedom)
        # the least displacement by one parameter, by its standard deviation 1 / scale
        tells = precision > 0.0
        move = float((moves[tells] / scale[tells]).min())
        return GroupTest(
            name=SHOWN.get(name, name),
            p_value=min(1.0, self.count * chance),
            statistic=statistic,
            freedom=freedom,
            smallest=self._smallest(freedom, move),
        )

    def _smallest(self, freedom: int, move: float) -> float:
        """Displacement [unit] by the least change that fires nine times in ten.

        The square of that, in standard deviations, is the noncentrality of a chi-square.

        freedom : degrees of freedom of the test
        move : displacement by one standard deviation [unit]
        """
        from scipy.special import chndtrinc, fdtri

        threshold = 1.0 - FALSE_ALARM / self.count
        needed = freedom * float(fdtri(freedom, self.noise_freedom, threshold))
        # with hardly a row left for the noise no change is large enough
        if needed >= SIGNIFICANCE.largest:
            return math.inf
        square = chndtrinc(needed, freedom, 1.0 - SIGNIFICANCE.power)
        return float(np.sqrt(square * self.correlation_time)) * move


def moves_of(structure: Structure, beta: Array, probes: Array) -> Array:
    """Displacement (d,) of joints (p, dof) by one of each parameter, root mean square [unit]."""
    with np.errstate(all="ignore"):
        _, columns = structure.linearise(probes, beta)
        moves = columns[:, : structure.blocks[0]]
        square = (moves**2).sum(axis=1)
    # a lens may fold over where no rows are
    finite = square[np.isfinite(square).all(axis=1)]
    rms: Array = np.sqrt(finite.sum(axis=0) / max(len(finite), 1))
    return rms


def group_tests(noise: NoiseFit, probes: Array) -> GroupTests:
    """Test every group against the belief as the model knows it.

    noise : of the observations under that belief
    probes : (p, dof), joints all over the learned range
    """
    system = noise.system
    reference = system.reference
    groups = groups_of(reference.structure, system.single_causes())
    nuisance = Nuisance(system, creep_share=CREEP_SHARE)
    tests = FTests(
        statistics=nuisance.statistics(system.y, system.x),
        noise=noise.size,
        noise_freedom=noise.freedom,
        correlation_time=noise.correlation_time,
        count=len(groups),
    )
    moves = moves_of(reference.structure, reference.beta, probes)
    return GroupTests(
        groups=tuple(tests.of_groups(groups, moves)),
        noise=noise.sd,
        usual=float(reference.body.noise[0]),
        noisy=None if noise.is_wavy else noise.noisy_joint,
        noisier=noise.is_larger,
        wavy=noise.is_wavy,
    )


@dataclass(frozen=True)
class BoundTest:
    """The rows that are beyond the model's own 95 % bound."""

    beyond: float  # share of them; those that contradict all others are, too
    usual: float  # median of the bounds of an arm that has not changed [unit]
    # whether each row is missed by about as much, independently
    may_be_noise: bool
    # whether rows of like joints, or that came from like sides, err alike
    repeats: bool
    # whether too many err so beyond what an arm may that has not changed
    is_contradicted: bool

    @property
    def holds(self) -> bool:
        """Whether they are about as many as usual."""
        return self.beyond <= BEYOND

    def words(self, *, changed: bool) -> str:
        """The share in words, and what it may be due to where nothing `changed`."""
        cause = ""
        if not changed:
            cause = NOISE if self.may_be_noise else NO_NOISE
        return (
            f"{100 * self.beyond:.0f} % of the rows are further from the prediction than its "
            f"bound, where 5 % should be: {cause}the bound does not hold"
        )


def bound_test(
    rows: LogRows,
    limit: Array,
    tolerance: Array,
    shared_variance: Array | float,
    tests: GroupTests,
) -> BoundTest:
    """Count the rows beyond the 95 % bound.

    rows : n of them that do not contradict all others
    limit : (n,), the bound of each row [unit]
    tolerance : (n,), that of an arm that has not changed [unit]
    shared_variance : (n,), of what all rows share [unit^2]
    """
    from scipy.special import chdtri

    residual = rows.x - rows.predicted
    square = (residual**2).sum(axis=1)
    # squared, of 95 % of a Gaussian, in deviations
    radius = float(chdtri(residual.shape[1], 0.05))
    variance = shared_variance
    # of a simulated arm the bound is on the true position, not on readings
    if rows.model.about.bound_of == "true position":
        variance = variance + tests.usual**2
    is_beyond = square > limit**2 + radius * variance
    beyond = np.count_nonzero(is_beyond) + rows.wrong
    is_missed = square > tolerance**2 + radius * shared_variance
    of_places = variance_of_places(rows.u, residual)
    is_systematic = tests.wavy or follows_sides(residual, rows.side)
    repeats = is_systematic or of_places * radius > tests.noise**2
    is_change = is_systematic or (repeats and tests.noisy is None)
    return BoundTest(
        beyond=float(beyond / (len(rows) + rows.wrong)),
        usual=float(np.median(tolerance)),
        may_be_noise=rows.few_wrong
        and not is_systematic
        and autocorrelation_time(residual) < LAGGING,
        repeats=repeats,
        is_contradicted=is_change and float(is_missed.mean()) > CONTRADICTED,
    )


def variance_of_all(reference: Reference, observations: LogRows) -> Array:
    """Variance (n,) of what all rows share: frame, and corrected clock [unit^2]."""
    # a frame is shifted and bent, that of the model's own log and that of this one
    extent = reference.structure.extents[0]
    bends = 1.0 + ((observations.x / extent) ** 2).sum(axis=1)
    variance = 2.0 * observations.shared**2 * bends
    # a clock is a little early or late for all rows
    slope = reference.structure.slope(observations.q, reference.beta)
    moves = slope @ observations.clock_sd[:, :, None]
    variance += (moves**2).sum(axis=(1, 2))
    return np.asarray(variance)


def variance_of_places(u: Array, residual: Array) -> float:
    """Variance of an axis by which rows of like joints err alike, 0 where that may be chance.

    Each row is compared with the nearest one between which and it noise does not last.

    u, residual : (n, dof), (n, m), joints in the unit box, and what the rows are missed by
    """
    from scipy.special import ndtri

    first, second = neighbours_apart_in_time(u)
    product = (residual[first] * residual[second]).sum(axis=1)
    # whatever its size, noise makes either sign as likely
    if product.sum() <= -ndtri(FALSE_ALARM) * np.linalg.norm(product):
        return 0.0
    variance: float = product.mean() / residual.shape[1]
    return variance


def neighbours_apart_in_time(u: Array) -> tuple[Index, Index]:
    """Pairs (p,), (p,) of rows of like joints (n, dof) between which noise does not last."""
    from scipy.spatial import cKDTree

    # of so many rows at least one is no neighbour in time
    count = min(2 * LASTING + 2, len(u))
    _, neighbours = cKDTree(u).query(u, count)
    near = np.asarray(neighbours)
    is_apart = np.abs(near - np.arange(len(u))[:, None]) > LASTING
    row = np.flatnonzero(is_apart.any(axis=1))
    nearest = is_apart[row].argmax(axis=1)
    pairs = np.sort(np.stack([row, near[row, nearest]], axis=1), axis=1)
    first, second = np.unique(pairs, axis=0).T
    return first, second


def follows_sides(residual: Array, side: Array) -> bool:
    """Whether residuals (n, m) differ, by no chance, with the side (n, dof) a joint came from.

    Along each axis the sum of side * residual is normal; of its square, over that of both::

        sum (side r)^2 / sum r^2 ~ chi-square (1)
    """
    from scipy.special import chdtrc

    products = np.einsum("nj,nm->njm", side, residual)
    variance = (products**2).sum(axis=0) + 1e-300
    statistic = products.sum(axis=0) ** 2 / variance
    chance = float(chdtrc(1, float(statistic.max())))
    return chance * float(statistic.size) < FALSE_ALARM
