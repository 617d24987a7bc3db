"""Tests: which freed group of parameters explains more of a log than chance does.

The noise is that of a fit in which every group may have changed: it is unknown, and it may be that
of one joint's encoder.  So what a group explains has the chance of an F test.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.parameters import Indices
from ..body.structure import Structure
from ..common.arrays import Array
from .causes import (
    FRAME,
    changeable,
    frame_twin,
    freedom,
    indices_of,
    single_causes,
)
from .frame import Reference
from .settings import CREEP, CREPT, FALSE_ALARM, NOISIER
from .system import (
    SYSTEM,
    NoisyJoint,
    Products,
    System,
    Unknown,
)


@dataclass(frozen=True)
class SignificanceSettings:
    """When something is no chance."""

    # noise of one encoder over that of the sensor, at the tip: steps of two left 2 of 90 drifted
    joint_noises: tuple[float, ...] = tuple(2.0 ** np.arange(-1.0, 6.5, 0.5))
    # share of logs in which the smallest change that is told would be found
    power: float = 0.9
    # times the noise of a change that rows have to be able to show: 10 rows of two joints, which
    # hardly tell the noise, show those of 11 to 37 times on, 12 rows 4 times
    large: float = 10.0
    # statistic beyond which no size of a change is computed
    largest: float = 1e8


SIGNIFICANCE = SignificanceSettings()
SHOWN = {"scale": "sensor scale", "tilt": "sensor tilt"}
"""Groups whose names alone do not say that they are the sensor's."""


class Change(NamedTuple):
    """Parameters of a group, how each changed, and the standard deviation of that, (p,) each."""

    indices: Indices
    sizes: Array
    deviations: Array


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``
    # chance of such rows where nothing changed, after Bonferroni
    p_value: float
    statistic: float = 0.0  # twice the gain in log likelihood
    freedom: int = 1  # directions that the rows tell apart
    change: Change | None = None
    # [unit], root mean square displacement, over the learned range, of the smallest change of the
    # parameter that these rows show best which they would show nine times in ten
    smallest: float = 0.0

    @property
    def score(self) -> float:
        """Logarithm of the p-value over that of `FALSE_ALARM`: above 1 it fired."""
        chance = max(self.p_value, 1e-300)
        return abs(math.log(chance) / math.log(FALSE_ALARM))


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


def alarms(groups: Iterable[GroupTest]) -> tuple[GroupTest, ...]:
    """Groups above their threshold, the most telling first."""
    above = [g for g in groups if g.score > 1.0]
    above.sort(key=lambda g: (-g.score, 3.0 * g.freedom - g.statistic))
    return tuple(above)


def groups_of(structure: Structure) -> dict[str, Indices]:
    """Return the groups that are tested: each cause alone and with the sensor, all geometry."""
    frame = indices_of(structure, FRAME)
    groups = {}
    for name, indices in single_causes(structure).items():
        groups[name] = indices
        if not np.isin(frame, indices).all():
            groups[f"{name} and sensor"] = np.concatenate([indices, frame])
    geometry = ("offset", "length", "gain", "elastic", *FRAME)
    groups["geometry"] = indices_of(structure, geometry)
    return groups


class FreeNoise:
    """The noise that is most likely where everything may have changed."""

    def __init__(self, system: System) -> None:
        reference = system.reference
        self.system = system
        self.unknown = Unknown(system, CREEP, CREPT, everything(reference))
        nothing = system.x[:, :0]
        self.products = self.unknown.products(system.y, nothing)
        self.usual = usual_noise(reference)
        # in `Reference.sizes`
        self.size = self.products.most_likely_noise(self.usual)
        self.likelihood = float(self.products.likelihood(self.size)[0])
        self.rest = self.unknown.rest(system.y, self.size)
        # rows that err together count once
        self.temper = autocorrelation_time(self.rest)

    def chance_beside(self, likelihood: float) -> float:
        """The chance of so much more likelihood by one more number."""
        from scipy.special import chdtrc

        gain = 2.0 * (self.likelihood - likelihood) / self.temper
        return float(chdtrc(1, max(gain, 0.0)))

    @property
    def larger(self) -> bool:
        """Whether it is larger than usual, and that is no chance."""
        likelihood = float(self.products.likelihood(self.usual)[0])
        chance = self.chance_beside(likelihood)
        return self.size > NOISIER * self.usual and chance < FALSE_ALARM

    def of_one_joint(self) -> FreeNoise:
        """The same where the encoder of one joint alone makes it larger."""
        system = self.system
        slope = system.slope / system.reference.sizes[:, None]
        lengths = (slope**2).sum(axis=1)
        # so that at the tip all are alike
        mean = lengths.mean(axis=0)
        typical = np.sqrt(np.maximum(mean, 1e-300))
        joint = self._noisiest_joint(slope, lengths, typical)
        noises = []
        for times in SIGNIFICANCE.joint_noises:
            noisy = joint, times / float(typical[joint])
            other = System(system.reference, system.log, noisy)
            noises.append(FreeNoise(other))
        best = max(noises, key=lambda noise: noise.likelihood)
        chance = best.chance_beside(self.likelihood)
        chance *= 1 + len(typical)
        return best if chance < FALSE_ALARM else self

    def _noisiest_joint(
        self, slope: Array, lengths: Array, typical: Array
    ) -> int:
        """The joint whose noise makes the residuals most likely, by one step.

        slope, lengths, typical : (n, m, dof), (n, dof), (dof,), how a joint moves the tip, the
            squares of that, and its usual size, in the sensor's noise
        """
        residual = (self.rest**2).sum(axis=1)
        square = residual[:, None]
        along = np.einsum("nmd,nm->nd", slope, self.rest) ** 2
        gains = []
        for times in SIGNIFICANCE.joint_noises:
            ratio = (times / typical) ** 2
            value = 1.0 + ratio * lengths
            rest = square - ratio * along / value
            variance = rest.mean(axis=0)
            gain = self.rest.size * np.log(square.mean() / variance)
            gains.append(gain - np.log(value).sum(axis=0))
        best = np.max(gains, axis=0)
        return int(np.argmax(best))

    def tests(self, products: Products, count: int) -> FTests:
        """F tests of columns by their products, beside this noise; `count` of them."""
        freedom = self.products.freedom(self.size)
        freedom /= self.temper
        return FTests(products, self.size, freedom, self.temper, count)


def everything(reference: Reference) -> Array:
    """Standard deviation (d,) by which the parameters may have changed, all together."""
    # what bends the joints, and couplings, would leave few rows no freedom
    groups = set(changeable(reference.structure))
    groups -= {"elastic", "payload", "coupling"}
    sd = freedom(reference.body, groups, forgotten=reference.forgotten)
    # the frame turns about the first joint's axis as its offset does: it is free once
    sd[frame_twin(reference.body)] = 0.0
    return sd


def usual_noise(reference: Reference) -> float:
    """The noise that a belief expects, in `Reference.sizes`."""
    usual = float(np.min(reference.body.noise / reference.sizes))
    return max(usual, SYSTEM.exact)


@dataclass(frozen=True)
class FTests:
    """F tests of columns, each beside what an unchanged arm may show."""

    products: Products
    noise: float
    left: float  # directions of the rows that tell the noise
    temper: float  # rows that count for one
    count: int  # tests, of which one may fire by chance

    def of_groups(
        self, groups: dict[str, Indices], moves: Array
    ) -> list[GroupTest]:
        """Test groups of columns (k,), whose displacements (rms) are those by one of each [unit].

        What the rows tell nothing of is left out.
        """
        power, pull = self.products.information(self.noise)
        precision = np.diag(power)
        tests = []
        for name, at in groups.items():
            if precision[at].max() > 0.0:  # a tracker has no lens
                block = power[np.ix_(at, at)]
                test = self.of_change(name, at, block, pull[at], moves[at])
                tests.append(test)
        return tests

    def chance(self, statistic: float, freedom: float) -> float:
        """Return the chance of a statistic, after Bonferroni."""
        from scipy.special import fdtrc

        left = max(self.left, 1e-3)
        chance = float(fdtrc(freedom, left, statistic / freedom))
        return min(1.0, self.count * chance)

    def of_change(
        self,
        name: str,
        indices: Indices,
        power: Array,
        pull: Array,
        moves: Array,
    ) -> GroupTest:
        """Test parameters (k,) by their information.

        moves : (k,), root mean square displacement by one of each [unit]
        """
        from scipy.special import chndtrinc, fdtri

        precision = np.diag(power)
        size = np.sqrt(np.maximum(precision, 1e-300))
        values, vectors = np.linalg.eigh(power / size[:, None] / size)
        clear = values > 1e-9 * values[-1]
        values = values[clear]
        vectors = vectors[:, clear] / size[:, None]
        along = vectors.T @ pull
        freedom = len(values)
        gain = float((along**2 / values).sum())
        statistic = gain / self.temper
        variance = (vectors**2 / values).sum(axis=1)
        deviation = np.sqrt(variance * self.temper)
        threshold = 1.0 - FALSE_ALARM / self.count
        needed = freedom * float(fdtri(freedom, self.left, threshold))
        # with hardly a row left for the noise no change is large enough
        smallest = math.inf
        if needed < SIGNIFICANCE.largest:
            square = chndtrinc(needed, freedom, 1.0 - SIGNIFICANCE.power)
            distance = np.sqrt(square * self.temper)
            some = precision > 0.0
            least = (moves[some] / size[some]).min()
            smallest = float(distance * least)
        return GroupTest(
            name=SHOWN.get(name, name),
            p_value=self.chance(statistic, freedom),
            statistic=statistic,
            freedom=freedom,
            change=Change(indices, vectors @ (along / values), deviation),
            smallest=smallest,
        )


def moves_of(structure: Structure, beta: Array, probes: Array) -> Array:
    """Displacement (d,) of joints (p, dof) by one of each parameter, root mean square [unit]."""
    _, columns = structure.linearise(probes, beta)
    moves = columns[:, : structure.blocks[0]]
    square = (moves**2).sum(axis=1)
    rms: Array = np.sqrt(square.mean(axis=0))
    return rms


def group_tests(noise: FreeNoise, probes: Array) -> GroupTests:
    """Test every group against the belief as the model knows it.

    noise : of the log beside this
    probes : (p, dof), joints all over the learned range
    """
    reference = noise.system.reference
    structure = reference.structure
    groups = groups_of(structure)
    noisier = not reference.is_fitted and noise.larger
    if noisier:
        noise = noise.of_one_joint()
        noisier = noise.larger
    system = noise.system
    noisy = system.noisy
    unknown = Unknown(system, CREEP, CREPT)
    tests = noise.tests(unknown.products(system.y, system.x), len(groups))
    moves = moves_of(structure, reference.beta, probes)
    results = tests.of_groups(groups, moves)
    return GroupTests(
        groups=tuple(results),
        noise=noise.size * float(reference.sizes[0]),
        usual=float(reference.body.noise[0]),
        noisy=None if noisy is None else (noisy[0], noisy[1] * noise.size),
        noisier=noisier,
    )
