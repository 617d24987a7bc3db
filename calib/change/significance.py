"""Significance: F tests of groups of parameters, each given what an unchanged arm may show.

For the columns X of a group and C = K + s^2 I::

    d = (X' C^-1 X)^-1 X' C^-1 y,    y' C^-1 X d / k ~ F(k, f)    where nothing changed

k are the directions that the rows determine, f the degrees of freedom that they leave to the noise
(`Statistics.noise_freedom`).  The noise s is the most likely one where all groups may have
changed, or where one encoder is noisy; since it is estimated, the tests are F tests.
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
from .noise import FALSE_ALARM, NoiseFit, f_chance, score_of
from .rows import LogRows
from .system import CREEP_SHARE, NoisyJoint, Nuisance, Statistics


@dataclass(frozen=True)
class SignificanceSettings:
    """When something is no chance."""

    # share of logs that would show a change of the smallest size reported
    power: float = 0.9
    # a change that rows have to be able to show, over the noise: 10 rows of two joints, which
    # hardly determine the noise, show changes from 11 to 37 times on, 12 rows from 4 times on
    large: float = 10.0
    # statistic beyond which no size of a change is computed
    largest: float = 1e8


SIGNIFICANCE = SignificanceSettings()

# Correlation time of residuals that are no longer noise [rows]
LONGEST_NOISE = 3.0
NOISE_ROWS = 10  # rows over which noise may be correlated
# Largest share of rows beyond a 95 % bound that holds: halves of A and C have at most 13 %
MOST_BEYOND = 0.2
# Share of rows beyond their tolerance from which errors that repeat are a change: pieces of
# unchanged halves have at most .25, waves of 60 cycles and 3 mrad .47
LEAST_CONTRADICTED = 1.0 / 3.0
NOISE = "a noisier sensor or encoder, "
NO_NOISE = "no noise, wrong rows, another sensor's or an unknown change, "
PRINTED_NAMES = {"scale": "sensor scale", "tilt": "sensor tilt"}
"""Printed names of groups whose own names do not say that they are the sensor's."""


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``
    # chance of such rows where nothing changed, after Bonferroni
    p_value: float
    statistic: float = 0.0  # twice the gain in log likelihood
    freedom: int = 1  # degrees of freedom: directions that the rows determine
    # [unit], root mean square displacement over the learned range by the smallest change that such
    # rows would show nine times in ten, of the parameter that they show best
    smallest: float = 0.0

    @property
    def score(self) -> float:
        """Logarithm of the p-value over that of `FALSE_ALARM`: above 1 it fired."""
        return score_of(self.p_value)


@dataclass(frozen=True)
class GroupTests:
    """All groups of one log."""

    groups: tuple[GroupTest, ...]
    # [unit], standard deviation per axis that no group explains
    noise: float
    usual: float  # [unit], noise that the belief expects
    # a joint whose encoder is noisy, with its noise [rad or m]
    noisy_joint: NoisyJoint | None = None
    # whether the noise is larger than usual, by more than chance
    is_noisier: bool = False
    # whether joints have waves that may be those of an arm that has not changed
    is_wavy: bool = False

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
        """Displacement [unit] from which the rows would show a change of any group."""
        return max(self._sizes, default=np.inf)


def groups_of(
    structure: Structure, causes: Mapping[str, Indices]
) -> dict[str, Indices]:
    """Return the tested groups: each cause alone, each with the sensor, and all geometry."""
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
    count: int  # number of tests, for Bonferroni's correction

    def of_groups(
        self, groups: dict[str, Indices], moves: Array
    ) -> list[GroupTest]:
        """Test groups of the columns, except those that the rows do not determine.

        moves : (k,), root mean square displacement by a unit of each parameter [unit]
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

        moves : (k,), root mean square displacement by a unit of each [unit]
        """
        # matrix = S V diag(values) V' S; the rows determine the directions S^-1 V of large values
        precision = np.diag(matrix)
        scale = np.sqrt(np.maximum(precision, 1e-300))
        values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale)
        is_determined = values > 1e-9 * values[-1]
        values = values[is_determined]
        directions = vectors[:, is_determined] / scale[:, None]
        along = directions.T @ vector
        statistic = float((along**2 / values).sum()) / self.correlation_time
        freedom = len(values)
        chance = f_chance(statistic, freedom, self.noise_freedom)
        # the least displacement by the standard deviation 1 / scale of one parameter
        is_seen = precision > 0.0
        move = float((moves[is_seen] / scale[is_seen]).min())
        return GroupTest(
            name=PRINTED_NAMES.get(name, name),
            p_value=min(1.0, self.count * chance),
            statistic=statistic,
            freedom=freedom,
            smallest=self._smallest(freedom, move),
        )

    def _smallest(self, freedom: int, move: float) -> float:
        """Displacement [unit] by the smallest change that fires nine times in ten.

        The square of that change, in standard deviations, is the noncentrality of a chi-square.

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
    """Root mean square displacement (d,) of joints (p, dof) by a unit of each parameter [unit]."""
    with np.errstate(all="ignore"):
        _, columns = structure.linearise(probes, beta)
        moves = columns[:, structure.position]
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
        statistics=nuisance.statistics(system.y, system.columns),
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
        noisy_joint=None if noise.is_wavy else noise.noisy_joint,
        is_noisier=noise.is_larger,
        is_wavy=noise.is_wavy,
    )


@dataclass(frozen=True)
class BoundTest:
    """A test of the model's own 95 % bound by the rows."""

    beyond: float  # share of rows beyond the bound, strays among them
    usual: float  # median tolerance of an arm that has not changed [unit]
    # whether the errors of the rows look independent and of one size
    may_be_noise: bool
    # whether rows of similar joints, or that came from the same side, have similar errors
    repeats: bool
    # whether errors that repeat are beyond the tolerance in too many rows
    is_contradicted: bool

    @property
    def holds(self) -> bool:
        """Whether about as few rows as usual are beyond the bound."""
        return self.beyond <= MOST_BEYOND

    def words(self, *, changed: bool) -> str:
        """The share beyond the bound in words and, where nothing `changed`, its possible causes."""
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
    """Test the 95 % bound.

    rows : n rows of the log, without strays
    limit : (n,), the bound of each row [unit]
    tolerance : (n,), the bound of an arm that has not changed since it was made [unit]
    shared_variance : (n,), of the errors that all rows share [unit^2]
    """
    from scipy.special import chdtri

    residual = rows.x - rows.predicted
    square = (residual**2).sum(axis=1)
    # square of the radius that holds 95 % of a standard Gaussian
    radius = float(chdtri(residual.shape[1], 0.05))
    variance = shared_variance
    # of a simulated arm the bound is on the true position, not on readings
    if rows.model.about.bound_of == "true position":
        variance = variance + tests.usual**2
    is_beyond = square > limit**2 + radius * variance
    beyond = np.count_nonzero(is_beyond) + rows.strays
    is_missed = square > tolerance**2 + radius * shared_variance
    variance_by_joints = variance_of_places(rows.u, residual)
    is_systematic = tests.is_wavy or follows_sides(residual, rows.side)
    repeats = is_systematic or variance_by_joints * radius > tests.noise**2
    is_change = is_systematic or (repeats and tests.noisy_joint is None)
    return BoundTest(
        beyond=float(beyond / (len(rows) + rows.strays)),
        usual=float(np.median(tolerance)),
        may_be_noise=rows.has_few_strays
        and not is_systematic
        and autocorrelation_time(residual) < LONGEST_NOISE,
        repeats=repeats,
        is_contradicted=is_change
        and float(is_missed.mean()) > LEAST_CONTRADICTED,
    )


def variance_of_all(reference: Reference, observations: LogRows) -> Array:
    """Variance (n,) of the errors that all rows share: of frame and corrected clock [unit^2]."""
    # the frames of the model's own log and of this one are shifted and bent
    extent = reference.structure.extents[0]
    bends = 1.0 + ((observations.x / extent) ** 2).sum(axis=1)
    variance = 2.0 * observations.shared**2 * bends
    # the clock is early or late for all rows
    slope = reference.structure.slope(observations.q, reference.beta)
    moves = slope @ observations.clock_sd[:, :, None]
    variance += (moves**2).sum(axis=(1, 2))
    return np.asarray(variance)


def variance_of_places(u: Array, residual: Array) -> float:
    """Variance per axis of the error that rows of similar joints share, 0 where it may be chance.

    Each row is compared with the nearest one that is too far apart in time to share its noise.

    u, residual : (n, dof), (n, m), joints in the unit box, and residuals
    """
    from scipy.special import ndtri

    first, second = neighbours_apart_in_time(u)
    product = (residual[first] * residual[second]).sum(axis=1)
    # noise of any size makes both signs equally likely
    if product.sum() <= -ndtri(FALSE_ALARM) * np.linalg.norm(product):
        return 0.0
    return float(product.mean() / residual.shape[1])


def neighbours_apart_in_time(u: Array) -> tuple[Index, Index]:
    """Pairs (p,), (p,) of rows of similar joints (n, dof), too far apart in time to share noise."""
    from scipy.spatial import cKDTree

    # among as many neighbours at least one is far apart in time
    count = min(2 * NOISE_ROWS + 2, len(u))
    _, neighbours = cKDTree(u).query(u, count)
    near = np.asarray(neighbours)
    is_apart = np.abs(near - np.arange(len(u))[:, None]) > NOISE_ROWS
    row = np.flatnonzero(is_apart.any(axis=1))
    nearest = is_apart[row].argmax(axis=1)
    pairs = np.sort(np.stack([row, near[row, nearest]], axis=1), axis=1)
    first, second = np.unique(pairs, axis=0).T
    return first, second


def follows_sides(residual: Array, side: Array) -> bool:
    """Whether residuals (n, m) depend, by more than chance, on the side (n, dof) a joint came from.

    Along each axis the sum of side * residual is normal, where they do not::

        (sum side r)^2 / sum (side r)^2 ~ chi-square (1)
    """
    from scipy.special import chdtrc

    products = np.einsum("nj,nm->njm", side, residual)
    variance = (products**2).sum(axis=0) + 1e-300
    statistic = products.sum(axis=0) ** 2 / variance
    chance = float(chdtrc(1, float(statistic.max())))
    return chance * float(statistic.size) < FALSE_ALARM
