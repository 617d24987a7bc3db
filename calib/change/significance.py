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
from ..common.arrays import Array, Mask
from .causes import indices_of
from .noise import (
    FALSE_ALARM,
    NoiseFit,
    f_chance,
    score_of,
)
from .order import follows_sides
from .rows import LogRows, neighbours_apart_in_time
from .system import CREEP_SHARE, NoisyJoint, Nuisance, Statistics


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

# Of noise: the least variance by the median row, over that by all of them (rows of another sensor
# .01, Student's t of 3 degrees .6), the largest share of rows that contradict all others, and the
# least time over which rows err together
EVEN = 0.1
FEW_WRONG = 0.05
LAGGING = 3.0
# Share of rows beyond a 95 % bound that fails for sure: halves of A and C have 13 % at most
BEYOND = 0.2
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
    usual: float  # median of the bounds [unit]
    test: GroupTest  # the chance of so many by noise
    # whether each row is missed by about as much, independently
    may_be_noise: bool
    # whether rows of like joints err alike by most of the scatter
    repeats: bool

    @property
    def fails(self) -> bool:
        """Whether they are too many, noise or not."""
        return self.beyond > BEYOND

    @property
    def holds(self) -> bool:
        """Whether they are about as many as usual."""
        return not self.fails and self.test.score <= 1.0

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
    """Count the rows beyond the 95 % bound, against what a noisier sensor or encoder would do.

    rows : n of them that do not contradict all others
    limit : (n,), the bound of each row [unit]
    tolerance : (n,), that of an arm that has not changed [unit]
    shared_variance : (n,), of what all rows share [unit^2]
    """
    from scipy.special import chdtri

    residual = rows.x - rows.predicted
    square = (residual**2).sum(axis=1)
    usual = float(np.median(tolerance))
    # squared, of 95 % of a Gaussian, in deviations
    radius = float(chdtri(residual.shape[1], 0.05))
    noise = _noise_of_sensor(square, residual.shape[1], tests)
    # rows of like joints that err alike are no noisier sensor
    of_places = variance_of_places(rows, residual)
    if tests.wavy or of_places * radius > usual**2:
        noise = 0.0
    by_noise = noise + _noise_of_joint(rows, tests)
    variance = shared_variance
    # of a simulated arm the bound is on the true position, not on readings
    if rows.model.about.bound_of == "true position":
        variance = variance + tests.usual**2
    is_beyond = square > limit**2 + radius * variance
    variance = shared_variance + by_noise
    is_beyond_noise = square > tolerance**2 + radius * variance
    test = GroupTest("bound", _chance(is_beyond_noise))
    count = len(rows) + rows.wrong
    few_wrong = rows.wrong <= max(FEW_WRONG * count, 1)
    may_be_noise = few_wrong and not tests.wavy
    may_be_noise &= _looks_like_noise(residual)
    may_be_noise &= not follows_sides(residual, rows.side)
    return BoundTest(
        beyond=(np.count_nonzero(is_beyond) + rows.wrong) / count,
        usual=usual,
        test=test,
        may_be_noise=may_be_noise,
        repeats=tests.wavy or of_places > 0.5 * tests.noise**2,
    )


def _looks_like_noise(residual: Array) -> bool:
    """Whether the nearer half of residuals (n, m) is as large, and none is as the one before."""
    from scipy.special import chdtri

    square = (residual**2).sum(axis=1)
    usual = float(chdtri(residual.shape[1], 0.5)) / residual.shape[1]
    is_even = float(np.median(square)) > EVEN * usual * float(square.mean())
    return is_even and autocorrelation_time(residual) < LAGGING


def _chance(beyond: Mask) -> float:
    """Chance (binomial) of so many rows (n,) beyond a bound that as many as usual may exceed.

    Rows that err together count once.
    """
    from scipy.special import bdtrc

    if not beyond.any():
        return 1.0
    time = autocorrelation_time(beyond[:, None].astype(float))
    count = int(beyond.sum() / time)
    independent = math.ceil(len(beyond) / time)
    return float(bdtrc(count - 1, independent, BEYOND)) if count else 1.0


def _noise_of_sensor(square: Array, outputs: int, tests: GroupTests) -> float:
    """Variance of an axis [unit^2] beyond the usual one, of squared distances (n,)."""
    from scipy.special import chdtri

    # half of the rows of a noisier sensor are nearer than its median
    median = float(np.median(square)) / float(chdtri(outputs, 0.5))
    return max(max(tests.noise**2, median) - tests.usual**2, 0.0)


def _noise_of_joint(rows: LogRows, tests: GroupTests) -> Array:
    """Variance (n,) [unit^2] of the rows by a joint whose encoder is noisy."""
    if tests.noisy is None:
        return np.zeros(len(rows))
    joint, sd = tests.noisy
    body = rows.body
    slope = body.structure.slope(rows.q, body.beta)
    moves = slope[..., joint] ** 2
    variance: Array = sd**2 * moves.sum(axis=1)
    return variance


def variance_of_places(rows: LogRows, residual: Array) -> float:
    """Variance of an axis by which rows of like joints err alike, 0 where that may be chance."""
    from scipy.special import ndtri

    first, second = neighbours_apart_in_time(rows.u)
    if not len(first):
        return 0.0
    product = (residual[first] * residual[second]).sum(axis=1)
    # whatever its size, noise makes either sign as likely
    sure = product.sum() > -ndtri(FALSE_ALARM) * np.linalg.norm(product)
    return float(product.mean()) / residual.shape[1] if sure else 0.0
