"""Tests: which freed group of parameters explains more of a log than chance does.

The noise is that of a fit in which every group may have changed: it is unknown, and it may be that
of one joint's encoder.  So what a group explains has the chance of an F test.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.parameters import Indices
from ..body.structure import Structure
from ..common.arrays import Array
from ..common.rows import thinned
from .causes import FRAME, changeable, freedom, indices_of, single_causes
from .settings import CREPT, FALSE_ALARM, LARGE, NOISIER, OWN
from .system import NoisyJoint, System, Unknown, own_columns


@dataclass(frozen=True)
class SignificanceSettings:
    """When something is no chance."""

    # noise of one encoder over that of the sensor, at the tip: steps of two left 2 of 90 drifted
    joint_noises: tuple[float, ...] = tuple(2.0 ** np.arange(-1.0, 6.5, 0.5))
    # share of logs in which the smallest change that is told would be found
    power: float = 0.9
    # statistic beyond which no size of a change is computed
    largest: float = 1e8
    # rows over which noise may last
    lasting: int = 10
    # of a joint's rows that come from either side, or nothing tells its play
    least_share: float = 0.1
    # of the squared residuals: what explains less does not pay in `calib.body.approach` either
    least_explained: float = 0.06


SIGNIFICANCE = SignificanceSettings()


SHOWN = {"scale": "sensor scale", "tilt": "sensor tilt"}
"""Groups whose names alone do not say that they are the sensor's."""


DRIFT = "drift"
"""Name of the hypotheses that a smooth residual or waves are larger than the model told."""


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``, ``"drift"``
    # chance of such rows where nothing changed, after Bonferroni
    p_value: float
    statistic: float = 0.0  # twice the gain in log likelihood
    freedom: int = 1  # directions that the rows tell apart
    # (p,), its parameters, how each changed, and the standard deviation of that
    change: tuple[Indices, Array, Array] | None = None
    # [unit], root mean square displacement, over the learned range, of the smallest change of the
    # parameter that these rows show best which they would show nine times in ten
    smallest: float = 0.0

    @property
    def score(self) -> float:
        """Logarithm of the p-value over that of `FALSE_ALARM`: above 1 it fired."""
        return abs(math.log(max(self.p_value, 1e-300)) / math.log(FALSE_ALARM))


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
        return max((g.score for g in self.groups), default=0.0)

    @property
    def _sizes(self) -> list[float]:
        return [g.smallest for g in self.groups if g.smallest > 0.0]

    @property
    def too_few(self) -> bool:
        """Whether the rows could not show a large change of any group."""
        least = min(self._sizes, default=np.inf)
        return least > LARGE * max(self.noise, self.usual)

    @property
    def smallest(self) -> float:
        """Displacement [unit] that any single cause would have shown."""
        return max(self._sizes, default=np.inf)


@dataclass(frozen=True)
class Play:
    """A joint that has more play than the model knows."""

    joint: int
    half: Array  # (dof,), half of its play, the other joints' zero [rad or m]
    deviation: float  # standard deviation of that
    score: float  # above 1 it is no chance


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
    """The noise that is most likely where everything may have changed, of one shape."""

    def __init__(self, system: System, noisy: NoisyJoint | None = None) -> None:
        reference = system.reference
        # the unit weights of a payload would leave few rows no freedom
        groups = set(changeable(reference.structure)) - {"payload"}
        sd = freedom(
            reference.body,
            tuple(sorted(groups)),
            forgotten=reference.forgotten,
        )
        unknown = Unknown(
            reference, system.log, OWN[0], crept=CREPT, freed=sd, noisy=noisy
        )
        y = unknown.whiten(system.residual)
        self.y = y
        self.unknown = unknown
        # in `Reference.sizes`
        self.size = unknown.most_likely_noise(y, unknown.usual)
        self.likelihood = float(unknown.likelihood(y, self.size)[0])
        self.shape = noisy
        self.rest = unknown.rest(y, self.size)
        # rows that err together count once
        self.temper = autocorrelation_time(self.rest)
        # directions of the rows that tell the noise
        noise_share = self.size**2 / (self.size**2 + unknown.values)
        self.left = (len(y) - float((1.0 - noise_share**2).sum())) / self.temper

    @property
    def larger(self) -> bool:
        """Whether it is larger than usual, and that is no chance."""
        usual = self.unknown.usual
        if self.size <= NOISIER * usual:
            return False
        likelihood = float(self.unknown.likelihood(self.y, usual)[0])
        return self.chance_beside(likelihood) < FALSE_ALARM

    def chance_beside(self, likelihood: float) -> float:
        """The chance of so much more likelihood by one more number."""
        from scipy.special import chdtrc

        gain = 2.0 * (self.likelihood - likelihood) / self.temper
        return float(chdtrc(1, max(gain, 0.0)))

    def of_one_joint(self, system: System) -> FreeNoise:
        """The same where the encoder of one joint alone makes it larger."""
        reference = system.reference
        slope = reference.structure.slope(system.log.q, reference.beta)
        slope = slope / reference.sizes[:, None]
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
        shaped = [
            FreeNoise(system, (joint, times / float(typical[joint])))
            for times in SIGNIFICANCE.joint_noises
        ]
        best = max(shaped, key=lambda noise: noise.likelihood)
        chance = best.chance_beside(self.likelihood) * (1 + len(typical))
        return best if chance < FALSE_ALARM else self


class FTests:
    """F tests of columns, each beside what an unchanged arm may show."""

    def __init__(self, system: System, noise: FreeNoise, count: int) -> None:
        self.noise = noise
        self.count = count  # of tests, of which one may fire by chance
        self.unknown = Unknown(
            system.reference, system.log, OWN[0], crept=CREPT, noisy=noise.shape
        )
        self.y = self.unknown.whiten(system.residual)

    def information(self, columns: Array) -> tuple[Array, Array]:
        """Return what the rows tell of columns (n, m, k): (k, k) and (k,)."""
        return self.unknown.information(
            self.y, self.unknown.whiten(columns), self.noise.size
        )

    def chance(self, statistic: float, freedom: float) -> float:
        """Return the chance of a statistic, after Bonferroni."""
        from scipy.special import fdtrc

        chance = fdtrc(freedom, self.noise.left, statistic / freedom)
        return min(1.0, self.count * float(chance))

    def of_change(
        self,
        name: str,
        indices: Indices,
        power: Array,
        pull: Array,
        moves: Array,
    ) -> GroupTest | None:
        """Test parameters (k,) by their information; None where the rows tell nothing of them.

        moves : (k,), root mean square displacement by one of each [unit]
        """
        from scipy.special import chndtrinc, fdtri

        precision = np.diag(power)
        if not precision.max() > 0.0:  # a tracker has no lens
            return None
        size = np.sqrt(np.maximum(precision, 1e-300))
        values, vectors = np.linalg.eigh(power / size[:, None] / size)
        clear = values > 1e-9 * values[-1]
        values = values[clear]
        vectors = vectors[:, clear] / size[:, None]
        turned = vectors.T @ pull
        freedom = len(values)
        temper = self.noise.temper
        statistic = float((turned**2 / values).sum()) / temper
        deviation = np.sqrt((vectors**2 / values).sum(axis=1) * temper)
        threshold = 1.0 - FALSE_ALARM / self.count
        needed = freedom * float(fdtri(freedom, self.noise.left, threshold))
        # with hardly a row left for the noise no change is large enough
        smallest = math.inf
        if needed < SIGNIFICANCE.largest:
            shown = chndtrinc(needed, freedom, 1.0 - SIGNIFICANCE.power)
            least = moves[precision > 0.0] / size[precision > 0.0]
            smallest = float(np.sqrt(shown * temper) * least.min())
        return GroupTest(
            name=SHOWN.get(name, name),
            p_value=self.chance(statistic, freedom),
            statistic=statistic,
            freedom=freedom,
            change=(indices, vectors @ (turned / values), deviation),
            smallest=smallest,
        )

    def of_variance(self, columns: Array) -> GroupTest | None:
        """Test whether columns (n, m, k) of standard normals are larger (Satterthwaite 1946)."""
        power, pull = self.information(columns)
        mean = float(np.trace(power))
        if not mean > 0.0:
            return None
        spread = mean**2 / float((power**2).sum())
        statistic = spread * float(pull @ pull) / mean / self.noise.temper
        chance = self.chance(statistic, spread)
        return GroupTest(DRIFT, chance, statistic, round(spread))


def group_tests(system: System, probes: Array) -> Tested:
    """Test every group against the belief as the model knows it.

    probes : (p, dof), joints all over the learned range
    """
    reference = system.reference
    structure = reference.structure
    groups = groups_of(structure)
    noise = FreeNoise(system)
    noisier = not len(reference.forgotten) and noise.larger
    if noisier:
        noise = noise.of_one_joint(system)
        noisier = noise.larger
    noisy = noise.shape
    tests = FTests(system, noise, len(groups) + 2)
    power, pull = tests.information(system.columns)
    moves = structure.linearise(probes, system.at, system.indices)[1]
    moves = moves[:, : structure.blocks[0]]
    moves = np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    tested: list[GroupTest | None] = []
    for name, indices in groups.items():
        at = np.searchsorted(system.indices, indices)
        tested.append(
            tests.of_change(
                name, indices, power[np.ix_(at, at)], pull[at], moves[at]
            )
        )
    tested.append(tests.of_variance(own_columns(reference, system.log, 1.0)))
    # waves of the joints that are finer than the rows look like a noisy encoder
    if reference.body.rows and noisy is None:
        curves = indices_of(structure, ("curve",))
        waves = structure.linearise(system.log.q, system.at, curves)[1]
        waves *= structure.prior(("curve",)).sd[curves]
        tested.append(tests.of_variance(waves))
    return Tested(
        groups=tuple(test for test in tested if test is not None),
        noise=noise.size * float(reference.sizes[0]),
        usual=float(reference.body.noise[0]),
        noisy=None if noisy is None else (noisy[0], noisy[1] * noise.size),
        noisier=noisier,
    )


def find_play(system: System, side: Array) -> Play | None:
    """Find the joint whose play explains most beside all that may have changed; None for chance.

    A joint stands by half its play from where it stands coming from the other side: one more
    column, the slope of the readings times the side.

    side : (n, dof), sign of each joint's last motion
    """
    from scipy.special import fdtrc

    side = side[thinned(len(side), len(system.log.q))]
    noise = FreeNoise(system)
    unknown = noise.unknown
    reference = system.reference
    slope = reference.structure.slope(system.log.q, reference.beta)
    columns = unknown.whiten(-slope * side[:, None])
    power, pull = unknown.information(noise.y, columns, noise.size)
    precision = np.maximum(np.diag(power), 1e-300)
    half = pull / precision
    moved = unknown.rest(columns, noise.size)
    by_row = np.einsum("nmd,nm->nd", moved, noise.rest)
    square = by_row.sum(axis=0) ** 2
    most = (moved**2).sum(axis=(0, 1)) * (noise.rest**2).sum()
    # an encoder that is noisy moves the tip along the same slope, to either side
    by_chance = square / (len(by_row) * by_row.var(axis=0) + 1e-300)
    statistic = np.minimum(half * pull / noise.temper, by_chance)
    shares = np.minimum((side > 0).mean(axis=0), (side < 0).mean(axis=0))
    may_play = (shares > SIGNIFICANCE.least_share) & (half > 0.0)
    may_play &= square > SIGNIFICANCE.least_explained * most
    statistic *= may_play
    best = int(np.argmax(statistic))
    freedom = max(noise.left - 1.0, 1e-3)
    chance = len(half) * float(fdtrc(1.0, freedom, statistic[best]))
    test = GroupTest("backlash", min(1.0, chance))
    if test.score <= 1.0:
        return None
    half *= np.arange(len(half)) == best
    deviation = math.sqrt(noise.temper / float(precision[best]))
    return Play(best, half, deviation, test.score)
