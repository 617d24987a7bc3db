"""Noise: its most likely size where all may have changed, one encoder's, and a joint's play.

They are estimated before any test: as the noise is estimated, a group has the chance of an F test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ..body.approach import Approach
from ..body.covariance import autocorrelation_time
from ..common.arrays import Array, Mask
from .causes import CREEP_WAVES, changeable, frame_twin
from .frame import Reference
from .rows import Observations
from .system import CREEP_SHARE, SYSTEM, NoisyJoint, Nuisance, System

# Share of undisturbed logs for which `check` may call anything changed, after Bonferroni
FALSE_ALARM = 1e-3
# Noise over the usual one from which it is reported, if no chance, and one encoder's is looked
# for: that of a log's body is a Student scale, up to 30 % less than the deviation of series C
NOISIER = 1.5

JOINT_NOISES = tuple(2.0 ** np.arange(-1.0, 6.5, 0.5))
"""Noise of one encoder over that of the sensor, at the tip: steps of two left 2 of 90 drifted."""


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """The noise s of the greatest likelihood where all parameters may have changed."""

    system: System
    nuisance: Nuisance  # K, with all that may have changed
    usual: float  # what the belief expects, in `Reference.sizes`
    size: float  # s, in the same
    likelihood: float  # of that [nats]
    likelihood_of_usual: float
    # (n, m), residuals less all that changes and K follow, s C^-1 y
    residual: Array
    # of these [rows]: rows that err together count once
    correlation_time: float
    # degrees of freedom: directions of the rows that determine the noise
    freedom: float
    # whether a joint has a wave, as it may be of an arm that has not changed
    is_wavy: bool = False

    @property
    def sd(self) -> float:
        """Standard deviation of an axis [unit]."""
        return self.size * float(self.system.reference.sizes[0])

    @property
    def noisy_joint(self) -> NoisyJoint | None:
        """The joint whose encoder is noisy, and its noise [rad or m]."""
        if self.system.noisy is None:
            return None
        joint, ratio = self.system.noisy
        return joint, ratio * self.size

    @property
    def is_larger(self) -> bool:
        """Whether it is larger than usual, and that is no chance."""
        chance = self.chance_beside(self.likelihood_of_usual)
        return self.size > NOISIER * self.usual and chance < FALSE_ALARM

    def chance_beside(self, likelihood: float) -> float:
        """Chance (chi-square, 1) of so much more likelihood by one more parameter."""
        from scipy.special import chdtrc

        gain = 2.0 * (self.likelihood - likelihood) / self.correlation_time
        return float(chdtrc(1, max(gain, 0.0)))


def noise_of(system: System) -> NoiseFit:
    """The most likely noise of a system."""
    reference = system.reference
    nuisance = Nuisance(
        system, CREEP_WAVES, CREEP_SHARE, sd_of_changes(reference)
    )
    statistics = nuisance.statistics(system.y, system.x[:, :0])
    usual = usual_noise(reference)
    size = statistics.most_likely_noise(usual)
    sizes = np.array([size, usual])
    likelihood, likelihood_of_usual = statistics.likelihood(sizes).tolist()
    residual = nuisance.rest(system.y, size)
    correlation_time = autocorrelation_time(residual)
    return NoiseFit(
        system=system,
        nuisance=nuisance,
        usual=usual,
        size=size,
        likelihood=likelihood,
        likelihood_of_usual=likelihood_of_usual,
        residual=residual,
        correlation_time=correlation_time,
        freedom=statistics.noise_freedom(size) / correlation_time,
    )


def noise_with_joint(noise: NoiseFit) -> NoiseFit:
    """A larger noise with that of one joint's encoder, where this is more likely than chance."""
    if not noise.is_larger:
        return noise
    system = noise.system
    # of a joint at the tip, in the sensor's noise: its slope by row, and what is typical
    slope = system.slope / system.reference.sizes[:, None]
    squares = (slope**2).sum(axis=1)
    typical = np.sqrt(np.maximum(squares.mean(axis=0), 1e-300))
    joint, step = _noisiest_joint(noise.residual, slope, squares, typical)

    @cache
    def fit_at(step: int) -> NoiseFit:
        ratio = JOINT_NOISES[step] / float(typical[joint])
        noisy = System(system.reference, system.observations, (joint, ratio))
        return noise_of(noisy)

    # from the guess to the nearest noise beside which none is more likely
    before = -1
    while step != before:
        before = step
        steps = range(max(step - 1, 0), min(step + 2, len(JOINT_NOISES)))
        step = max(steps, key=lambda step: fit_at(step).likelihood)
    best = fit_at(step)
    chance = best.chance_beside(noise.likelihood) * (1 + len(typical))
    return best if chance < FALSE_ALARM else noise


def _noisiest_joint(
    residual: Array, slope: Array, squares: Array, typical: Array
) -> tuple[int, int]:
    """The joint j, and which of `JOINT_NOISES`, that makes residuals r (n, m) most likely.

    A row has the covariance I + ratio^2 g g' (g the slope), and so the likelihood
    -2 log p = log(1 + ratio^2 g'g) + r'r - ratio^2 (g'r)^2 / (1 + ratio^2 g'g).

    slope, squares, typical : (n, m, dof), (n, dof), (dof,), g of each joint, g'g and its root
        mean, in the sensor's noise
    """
    square = (residual**2).sum(axis=1)[:, None]
    along = np.einsum("nmd,nm->nd", slope, residual) ** 2
    gains = []
    for times in JOINT_NOISES:
        ratio = (times / typical) ** 2
        variance = 1.0 + ratio * squares
        left_over = square - ratio * along / variance
        ratio_of_means = square.mean() / left_over.mean(axis=0)
        gain = residual.size * np.log(ratio_of_means)
        gains.append(gain - np.log(variance).sum(axis=0))
    step, joint = np.unravel_index(np.argmax(gains), np.shape(gains))
    return int(joint), int(step)


def sd_of_changes(reference: Reference) -> Array:
    """Standard deviation (d,) by which the parameters may have changed, all together."""
    # what bends the joints, and couplings, would leave few rows no freedom
    groups = set(changeable(reference.structure))
    groups -= {"elastic", "payload", "coupling"}
    sd = reference.sd_if_changed(groups)
    # the frame turns about the first joint's axis as its offset does: it is free once
    sd[frame_twin(reference.body)] = 0.0
    return sd


def usual_noise(reference: Reference) -> float:
    """The noise that a belief expects, in `Reference.sizes`."""
    usual = float(np.min(reference.body.noise / reference.sizes))
    return max(usual, SYSTEM.exact_noise)


def f_chance(statistic: float, freedom: float, noise_freedom: float) -> float:
    """Chance of a statistic of k degrees of freedom, F(k, f) times k where nothing changed."""
    from scipy.special import fdtrc

    ratio = statistic / freedom
    return float(fdtrc(freedom, max(noise_freedom, 1e-3), ratio))


def score_of(chance: float) -> float:
    """Logarithm of a chance over that of `FALSE_ALARM`: above 1 it is none."""
    chance = min(max(chance, 1e-300), 1.0)
    return abs(math.log(chance) / math.log(FALSE_ALARM))


@dataclass(frozen=True)
class PlaySettings:
    """When a joint has play."""

    # share of the play that a model knows by which that may be wrong: 20 mrad were learned as 19.1
    play_share: float = 0.1
    # least share of a joint's rows from either side that determines its play
    least_share: float = 0.1
    # least share of the squared residuals that a play explains
    least_explained: float = 0.06


PLAY = PlaySettings()


@dataclass(frozen=True)
class Play:
    """A joint that has more play than the model knows."""

    joint: int
    half: Array  # (dof,), half of its play, the other joints' zero [rad or m]
    deviation: float  # standard deviation of that
    score: float  # above 1 it is no chance, nor an error of what the model knows of it

    def taken_up(self, observations: Observations) -> Observations:
        """The observations at the joints' true values under this play."""
        q = observations.q - self.half * observations.side
        return replace(observations, q=q)


def find_play(noise: NoiseFit, approach: Approach | None) -> Play | None:
    """Find the joint whose play explains most besides all that may have changed; None for chance.

    A joint is off by half its play, towards the side from which it came.  Each row has
    f and r, what K does not follow of -slope * side and of the residual::

        half = sum f r / sum f^2,    statistic = (sum f r)^2 / sum (f r - mean f r)^2

    noise : of the log, given all that may have changed
    approach : the play that the model knows
    """
    system = noise.system
    side = system.observations.side
    features = noise.nuisance.rest(system.play_columns(), noise.size)
    products = np.einsum("nmd,nm->nd", features, noise.residual)
    squares = np.maximum((features**2).sum(axis=(0, 1)), 1e-300)
    total = products.sum(axis=0)
    half = total / squares
    explained = half * total / max((noise.residual**2).sum(), 1e-300)

    # an encoder that is noisy moves the tip along the same slope, to either side
    variance = len(products) * products.var(axis=0) + 1e-300
    statistic = total**2 / (variance * noise.correlation_time)
    # the model learned its own from rows, too, with an error that depends on their number
    statistic /= 1.0 + _rows_beside_training(system)
    may_play = _from_both_sides(side)
    may_play &= half > 0.0
    may_play &= explained > PLAY.least_explained
    statistic[~may_play] = 0.0
    joint = int(np.argmax(statistic))
    chance = len(half) * f_chance(float(statistic[joint]), 1.0, noise.freedom)
    score = score_of(chance)
    if score <= 1.0:
        return None
    play = np.zeros_like(half)
    play[joint] = half[joint]
    learned = 0.0 if approach is None else approach.play[joint]
    is_error = half[joint] <= PLAY.play_share * learned
    return Play(
        joint=joint,
        half=play,
        deviation=math.sqrt(noise.correlation_time / float(squares[joint])),
        score=0.0 if is_error else score,
    )


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


def _from_both_sides(side: Array) -> Mask:
    """Whether enough rows come from either side of each joint, (dof,), of sides (n, dof)."""
    above = (side > 0).mean(axis=0)
    below = (side < 0).mean(axis=0)
    smaller_share = np.minimum(above, below)
    return np.asarray(smaller_share > PLAY.least_share)


def _rows_beside_training(system: System) -> float:
    """Rows of the log for each one that the model learned from; 0 where it was simulated."""
    body = system.reference.body
    if body.simulated or not body.rows:
        return 0.0
    return len(system.observations.q) / body.rows
