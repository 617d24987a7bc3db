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
from ..common.arrays import Array, Mask
from ..common.rows import spread_rows
from .causes import (
    FRAME,
    changeable,
    doubled,
    freedom,
    indices_of,
    single_causes,
)
from .frame import Reference
from .rows import LogRows
from .settings import CREPT, FALSE_ALARM, NOISIER, OWN
from .system import (
    SYSTEM,
    NoisyJoint,
    Products,
    System,
    Unknown,
    own_columns,
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
    # Of the play that a model knows, by which that may be wrong: 20 mrad were learned as 19.1
    play_share: float = 0.1
    # of a joint's rows that come from either side, or nothing tells its play
    least_share: float = 0.1
    # of the squared residuals: what explains less does not pay in `calib.body.approach` either
    least_explained: float = 0.06


SIGNIFICANCE = SignificanceSettings()
SHOWN = {"scale": "sensor scale", "tilt": "sensor tilt"}
"""Groups whose names alone do not say that they are the sensor's."""
DRIFT = "drift"
"""Name of the hypotheses that a smooth residual or waves are larger than the model told."""


class Change(NamedTuple):
    """Parameters of a group, how each changed, and the standard deviation of that, (p,) each."""

    indices: Indices
    sizes: Array
    deviations: Array


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``, ``"drift"``
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
class Tested:
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


def fired(groups: Iterable[GroupTest]) -> tuple[GroupTest, ...]:
    """Groups above their threshold, the most telling first."""
    above = (g for g in groups if g.score > 1.0 and g.name != DRIFT)
    return tuple(
        sorted(above, key=lambda g: (-g.score, 3.0 * g.freedom - g.statistic))
    )


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
        self.unknown = Unknown(system, OWN[0], CREPT, everything(reference))
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
        square = (self.rest**2).sum(axis=1)[:, None]
        along = np.einsum("nmd,nm->nd", slope, self.rest) ** 2
        length = (slope**2).sum(axis=1)
        # so that at the tip all are alike
        typical = np.sqrt(np.maximum(length.mean(axis=0), 1e-300))
        gains = []
        for times in SIGNIFICANCE.joint_noises:
            ratio = (times / typical) ** 2
            value = 1.0 + ratio * length
            variance = (square - ratio * along / value).mean(axis=0)
            gain = self.rest.size * np.log(square.mean() / variance)
            gains.append(gain - np.log(value).sum(axis=0))
        joint = int(np.argmax(np.max(gains, axis=0)))
        noises = []
        for times in SIGNIFICANCE.joint_noises:
            noisy = joint, times / float(typical[joint])
            other = System(system.reference, system.log, noisy)
            noises.append(FreeNoise(other))
        best = max(noises, key=lambda noise: noise.likelihood)
        chance = best.chance_beside(self.likelihood) * (1 + len(typical))
        return best if chance < FALSE_ALARM else self

    def tests(self, products: Products, count: int) -> FTests:
        """F tests of columns by their products, beside this noise; `count` of them."""
        freedom = self.products.freedom(self.size)
        freedom /= self.temper
        return FTests(products, self.size, freedom, self.temper, count)


def everything(reference: Reference) -> Array:
    """Standard deviation (d,) by which the parameters may have changed, all together."""
    # the unit weights of a payload, and couplings, would leave few rows no freedom
    groups = set(changeable(reference.structure)) - {"payload", "coupling"}
    sd = freedom(reference.body, groups, forgotten=reference.forgotten)
    # the frame turns about the first joint's axis as its offset does: it is free once
    sd[doubled(reference.body)] = 0.0
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
        tests = []
        for name, at in groups.items():
            if np.diag(power)[at].max() > 0.0:  # a tracker has no lens
                block = power[np.ix_(at, at)]
                tests.append(
                    self.of_change(name, at, block, pull[at], moves[at])
                )
        return tests

    def chance(self, statistic: float, freedom: float) -> float:
        """Return the chance of a statistic, after Bonferroni."""
        from scipy.special import fdtrc

        chance = fdtrc(freedom, max(self.left, 1e-3), statistic / freedom)
        return min(1.0, self.count * float(chance))

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
        turned = vectors.T @ pull
        freedom = len(values)
        statistic = float((turned**2 / values).sum()) / self.temper
        variance = (vectors**2 / values).sum(axis=1)
        deviation = np.sqrt(variance * self.temper)
        threshold = 1.0 - FALSE_ALARM / self.count
        needed = freedom * float(fdtri(freedom, self.left, threshold))
        # with hardly a row left for the noise no change is large enough
        smallest = math.inf
        if needed < SIGNIFICANCE.largest:
            shown = chndtrinc(needed, freedom, 1.0 - SIGNIFICANCE.power)
            least = moves[precision > 0.0] / size[precision > 0.0]
            smallest = float(np.sqrt(shown * self.temper) * least.min())
        return GroupTest(
            name=SHOWN.get(name, name),
            p_value=self.chance(statistic, freedom),
            statistic=statistic,
            freedom=freedom,
            change=Change(indices, vectors @ (turned / values), deviation),
            smallest=smallest,
        )

    def of_variance(self) -> GroupTest:
        """Test whether all columns, of standard normals, are larger (Satterthwaite 1946)."""
        power, pull = self.products.information(self.noise)
        mean = float(np.trace(power))
        spread = mean**2 / float((power**2).sum())
        statistic = spread * float(pull @ pull) / mean / self.temper
        chance = self.chance(statistic, spread)
        return GroupTest(DRIFT, chance, statistic, round(spread))


def moves_of(reference: Reference, probes: Array) -> Array:
    """Displacement (d,) of joints (p, dof) by one of each parameter, root mean square [unit]."""
    structure = reference.structure
    moves = structure.linearise(probes, reference.beta)[1]
    moves = moves[:, : structure.blocks[0]]
    square = (moves**2).sum(axis=1)
    return np.asarray(np.sqrt(square.mean(axis=0)))


def group_tests(noise: FreeNoise, probes: Array) -> Tested:
    """Test every group against the belief as the model knows it.

    noise : of the log beside this
    probes : (p, dof), joints all over the learned range
    """
    reference = noise.system.reference
    structure = reference.structure
    groups = groups_of(structure)
    noisier = not reference.moved and noise.larger
    if noisier:
        noise = noise.of_one_joint()
        noisier = noise.larger
    system = noise.system
    noisy = system.noisy
    unknown = Unknown(system, OWN[0], CREPT)
    count = len(groups) + 2
    tests = noise.tests(unknown.products(system.y, system.x), count)
    results = tests.of_groups(groups, moves_of(reference, probes))
    drifts = [system.whiten(own_columns(reference, system.log, 1.0))]
    # waves of the joints that are finer than the rows look like a noisy encoder
    if reference.body.rows and noisy is None:
        curves = indices_of(structure, ("curve",))
        sd = structure.prior(("curve",)).sd[curves]
        drifts.append(system.x[:, curves] * sd)
    for columns in drifts:
        if columns.any():
            products = unknown.products(system.y, columns)
            results.append(noise.tests(products, count).of_variance())
    return Tested(
        groups=tuple(results),
        noise=noise.size * float(reference.sizes[0]),
        usual=float(reference.body.noise[0]),
        noisy=None if noisy is None else (noisy[0], noisy[1] * noise.size),
        noisier=noisier,
    )


@dataclass(frozen=True)
class Play:
    """A joint that has more play than the model knows."""

    joint: int
    half: Array  # (dof,), half of its play, the other joints' zero [rad or m]
    deviation: float  # standard deviation of that
    score: float  # above 1 it is no chance, nor an error of what the model knows of it


def find_play(noise: FreeNoise, rows: LogRows) -> Play | None:
    """Find the joint whose play explains most beside all that may have changed; None for chance.

    A joint stands by half its play from where it stands coming from the other side: one more
    column, the slope of the readings times the side. The model learned its own from rows, too,
    with an error that the number of these tells.
    """
    system = noise.system
    side = rows.side[spread_rows(len(rows), len(system.log.q))]
    columns = system.whiten(-system.slope * side[:, None])
    products = noise.unknown.products(system.y, columns)
    power, pull = products.information(noise.size)
    tests = noise.tests(products, side.shape[1])
    precision = np.maximum(np.diag(power), 1e-300)
    half = pull / precision
    moved = noise.unknown.rest(columns, noise.size)
    by_row = np.einsum("nmd,nm->nd", moved, noise.rest)
    square = by_row.sum(axis=0) ** 2
    squared_residual = (noise.rest**2).sum()
    squared_moves = (moved**2).sum(axis=(0, 1))
    explained = square / np.maximum(squared_residual * squared_moves, 1e-300)
    # an encoder that is noisy moves the tip along the same slope, to either side
    variance_of_rows = len(by_row) * by_row.var(axis=0)
    by_chance = square / (variance_of_rows + 1e-300)
    statistic = half * pull / noise.temper
    statistic = np.minimum(statistic, by_chance)
    statistic /= 1.0 + _rows_beside_training(system)
    may_play = _from_both_sides(side)
    may_play &= half > 0.0
    may_play &= explained > SIGNIFICANCE.least_explained
    statistic[~may_play] = 0.0
    best = int(np.argmax(statistic))
    test = GroupTest("backlash", tests.chance(float(statistic[best]), 1.0))
    if test.score <= 1.0:
        return None
    play = np.zeros_like(half)
    play[best] = half[best]
    approach = rows.model.approach
    learned = 0.0 if approach is None else approach.play[best]
    is_error = play[best] <= SIGNIFICANCE.play_share * learned
    return Play(
        joint=best,
        half=play,
        deviation=math.sqrt(noise.temper / float(precision[best])),
        score=0.0 if is_error else test.score,
    )


def _from_both_sides(side: Array) -> Mask:
    """Whether enough rows come from either side of each joint, (dof,), of sides (n, dof)."""
    above = (side > 0).mean(axis=0)
    below = (side < 0).mean(axis=0)
    smaller_share = np.minimum(above, below)
    return np.asarray(smaller_share > SIGNIFICANCE.least_share)


def _rows_beside_training(system: System) -> float:
    """Rows of the log for each one that the model learned from; 0 where it was simulated."""
    body = system.reference.body
    if body.simulated or not body.rows:
        return 0.0
    return len(system.log.q) / body.rows
