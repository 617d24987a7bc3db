"""Noise: its most likely size where all may have changed, one encoder's, play and waves of joints.

All of these are estimated before any test; since the noise is estimated, the tests are F tests.

A wave of N cycles a turn, as gears and the discs of encoders make them, moves a joint by
a cos(N q) + b sin(N q), which are two parameters of the joint's curve.  Their columns X are tested
as any group's (`significance`)::

    g = y' C^-1 X (X' C^-1 X)^-1 X' C^-1 y,    g / f ~ Beta(1, f / 2 - 1)  where there is no wave

f are the degrees of freedom of the noise, whose estimate includes the wave.  An encoder's noise
differs from row to row at one joint value; a wave does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.curves import HARMONICS
from ..body.parameters import Indices
from ..body.settings import PRIOR
from ..common.arrays import Array, Mask
from .causes import frame_twin, indices_of
from .frame import Reference
from .rows import LogRows
from .system import CREEP_SHARE, SYSTEM, NoisyJoint, Nuisance, System

# Share of undisturbed logs that `check` may call changed, after Bonferroni
FALSE_ALARM = 1e-3
# Noise over the usual one from which it is reported, unless it is chance, and one encoder's noise
# is searched: the noise of a log's body is a Student scale, up to 30 % less than the standard
# deviation of series C
NOISE_RATIO = 1.5

JOINT_NOISES = tuple(2.0 ** np.arange(-1.0, 6.5, 0.5))
"""Noise of one encoder over that of the sensor, at the tip: with steps of two, 2 of 90 unchanged
arms were drifted."""


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """The noise s of the greatest likelihood where all parameters may have changed."""

    system: System
    nuisance: Nuisance  # K, with all that may have changed
    usual: float  # the belief's noise, in `Reference.expected_noise`
    size: float  # s, in `Reference.expected_noise`
    likelihood: float  # log likelihood of s [nats]
    likelihood_of_usual: float  # log likelihood of the usual noise [nats]
    # (n, m), the part of the residuals that K does not explain, s C^-1 y
    residual: Array
    # [rows], of `residual`: rows that err together count once
    correlation_time: float
    # degrees of freedom: directions of the rows that determine the noise
    freedom: float
    # whether joints have waves that may be those of an arm that has not changed
    is_wavy: bool = False

    @property
    def sd(self) -> float:
        """Standard deviation of an axis [unit]."""
        return self.size * float(self.system.reference.expected_noise[0])

    @property
    def noisy_joint(self) -> NoisyJoint | None:
        """The joint whose encoder is noisy, and its noise [rad or m]."""
        if self.system.noisy_joint is None:
            return None
        joint, ratio = self.system.noisy_joint
        return joint, ratio * self.size

    @property
    def is_larger(self) -> bool:
        """Whether the noise is larger than usual, by more than chance."""
        chance = self.chance_beside(self.likelihood_of_usual)
        return self.size > NOISE_RATIO * self.usual and chance < FALSE_ALARM

    def chance_beside(self, likelihood: float) -> float:
        """Chance (chi-square, 1) that one more parameter gains as much over a likelihood."""
        from scipy.special import chdtrc

        gain = 2.0 * (self.likelihood - likelihood) / self.correlation_time
        return float(chdtrc(1, max(gain, 0.0)))


def noise_of(system: System) -> NoiseFit:
    """The most likely noise of a system."""
    reference = system.reference
    nuisance = Nuisance(
        system, creep_share=CREEP_SHARE, change_sd=sd_of_changes(reference)
    )
    statistics = nuisance.statistics(system.y)
    usual = usual_noise(reference)
    size = statistics.most_likely_noise(usual)
    sizes = np.array([size, usual])
    likelihood, likelihood_of_usual = statistics.likelihood(sizes).tolist()
    residual = nuisance.unexplained_part(system.y, size)
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
    """A noise larger than usual with the noise of one joint's encoder, unless that is chance."""
    if not noise.is_larger:
        return noise
    system = noise.system
    # how a joint moves the tip, in the sensor's noise: by row, and typically
    slope = system.slope / system.reference.expected_noise[:, None]
    squares = (slope**2).sum(axis=1)
    typical = np.sqrt(np.maximum(squares.mean(axis=0), 1e-300))
    joint, step = _noisiest_joint(noise.residual, slope, typical)

    @cache
    def fit_at(step: int) -> NoiseFit:
        ratio = JOINT_NOISES[step] / float(typical[joint])
        noisy = System(system.reference, system.observations, (joint, ratio))
        return noise_of(noisy)

    # from the guess to the nearest local maximum
    before = -1
    while step != before:
        before = step
        steps = range(max(step - 1, 0), min(step + 2, len(JOINT_NOISES)))
        step = max(steps, key=lambda step: fit_at(step).likelihood)
    best = fit_at(step)
    chance = best.chance_beside(noise.likelihood) * (1 + len(typical))
    return best if chance < FALSE_ALARM else noise


def _noisiest_joint(
    residual: Array, slope: Array, typical: Array
) -> tuple[int, int]:
    """The joint, and the number of its `JOINT_NOISES`, that make residuals r (n, m) most likely.

    A row has the covariance I + ratio^2 g g' (g the slope), and so the likelihood
    -2 log p = log(1 + ratio^2 g'g) + r'r - ratio^2 (g'r)^2 / (1 + ratio^2 g'g).

    slope, typical : (n, m, dof), (dof,), g of each joint and root mean g'g, in the sensor's noise
    """
    squares = (slope**2).sum(axis=1)
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
    sd = reference.sd_if_changed()
    # elasticity and couplings would leave few rows no freedom
    bending = ("elastic", "payload", "coupling")
    sd[indices_of(reference.structure, bending)] = 0.0
    # the frame may already turn about the first joint's axis
    sd[frame_twin(reference.body)] = 0.0
    return sd


def usual_noise(reference: Reference) -> float:
    """The noise that a belief expects, in `Reference.expected_noise`."""
    usual = float(np.min(reference.body.noise / reference.expected_noise))
    return max(usual, SYSTEM.exact_noise)


def f_chance(statistic: float, freedom: float, noise_freedom: float) -> float:
    """Chance of a statistic of k degrees of freedom, F(k, f) times k where nothing changed."""
    from scipy.special import fdtrc

    ratio = statistic / freedom
    return float(fdtrc(freedom, max(noise_freedom, 1e-3), ratio))


def share_chance(share: float, count: int, freedom: float) -> float:
    """Chance (beta) that k columns explain so large a share of f squares where nothing changed.

    share ~ Beta(k / 2, (f - k) / 2)
    """
    from scipy.special import betainc

    rest = max(freedom - count, 1e-3)
    return float(betainc(rest / 2, count / 2, 1.0 - min(share, 1.0)))


def score_of(chance: float) -> float:
    """Logarithm of a chance over that of `FALSE_ALARM`; above 1 it is no chance."""
    chance = min(max(chance, 1e-300), 1.0)
    return abs(math.log(chance) / math.log(FALSE_ALARM))


# Least share of the squared residuals that a play explains: a real UR10's wrist without play
# explained less in all but three of 252 checks
LEAST_EXPLAINED = 0.06


@dataclass(frozen=True)
class Play:
    """A joint that has more play than the model knows."""

    joint: int
    half: float  # half of its play [rad or m]
    deviation: float  # standard deviation of `half`
    score: float  # above 1 it is no chance

    def taken_up(self, observations: LogRows) -> LogRows:
        """The observations at the joints' true values under this play."""
        q = observations.q.copy()
        q[:, self.joint] -= self.half * observations.side[:, self.joint]
        return replace(observations, q=q)


def find_play(noise: NoiseFit) -> Play | None:
    """Find the joint whose play explains most besides all that may have changed; None for chance.

    A joint is off by half its play, towards the side from which it came.  Each row has
    f and r, the unexplained parts of -slope * side and of the residual::

        half = sum f r / sum f^2,    statistic = (sum f r)^2 / sum (f r - mean f r)^2

    noise : of the log, given all that may have changed
    """
    system = noise.system
    features = noise.nuisance.unexplained_part(
        system.play_columns(), noise.size
    )
    products = np.einsum("nmd,nm->nd", features, noise.residual)
    squares = np.maximum((features**2).sum(axis=(0, 1)), 1e-300)
    total = products.sum(axis=0)
    half = total / squares
    explained = half * total / max((noise.residual**2).sum(), 1e-300)

    # a noisy encoder moves the tip along the same slope, to both sides
    variance = len(products) * products.var(axis=0) + 1e-300
    statistic = total**2 / (variance * noise.correlation_time)
    # the model's own play was learned from rows, with an error that depends on their number
    body = system.reference.body
    if body.rows and not body.simulated:
        statistic /= 1.0 + len(products) / body.rows
    may_play = (half > 0.0) & (explained > LEAST_EXPLAINED)
    statistic[~may_play] = 0.0
    joint = int(np.argmax(statistic))
    chance = len(half) * f_chance(float(statistic[joint]), 1.0, noise.freedom)
    score = score_of(chance)
    if score <= 1.0:
        return None
    return Play(
        joint=joint,
        half=float(half[joint]),
        deviation=math.sqrt(noise.correlation_time / float(squares[joint])),
        score=score,
    )


@dataclass(frozen=True)
class WaveSettings:
    """When a joint has a wave."""

    # most waves of a log
    most: int = 6
    # largest amplitude of a wave that an unchanged arm may have and its model may not have learned
    # [rad]: a wave with the whole rms of a usual curve
    usual: float = math.sqrt(2.0) * PRIOR.curve_rms
    # share of a wave's effect from which another wave is its rival, and most nats by which a rival
    # explains the rows less: rows in a corner do not distinguish waves of 8 and 9 cycles
    likeness: float = 0.5
    nats: float = 5.0


WAVES = WaveSettings()
SHORT_WAVES = np.arange(HARMONICS + 1, 401)
"""Cycles a turn of waves that are too short for a curve."""


class Wave(NamedTuple):
    """A wave of one joint."""

    indices: Indices  # (2,), parameters of its cosine and sine
    # whether it is too large for an unchanged arm, and no other wave explains the rows as well
    is_cause: bool


def with_waves(noise: NoiseFit) -> NoiseFit:
    """A noise larger than usual without the waves of joints, found one by one, the clearest first.

    A wave also has to be no chance beside the noise of one joint's encoder.
    """
    if not noise.is_larger:
        return noise
    for _ in range(WAVES.most):
        beside_joint = noise_with_joint(noise)
        wave = _clearest_wave(beside_joint)
        if wave is None:
            is_wavy = _follows_short_waves(beside_joint)
            return replace(beside_joint, is_wavy=is_wavy)
        if beside_joint is not noise:
            wave = _clearest_wave(noise)
        if wave is None or not wave.is_cause:
            return replace(beside_joint, is_wavy=True)
        reference = noise.system.reference
        waves = np.append(reference.waves, wave.indices)
        reference = replace(reference, waves=waves)
        noise = noise_of(System(reference, noise.system.observations))
    return noise_with_joint(noise)


class WaveFits(NamedTuple):
    """Fits of w waves, each alone."""

    matrix: Array  # (w, 2, w, 2), X' C^-1 X
    covariances: Array  # (w, 2, 2)
    amplitudes: Array  # (w, 2), of cosine and sine [rad]
    # (w,), twice the gain in log likelihood of each wave at the given noise
    gains: Array
    # (w,), gain in log likelihood of each wave at the noise that it leaves
    nats: Array
    # chance of the largest gain where there is no wave, after Bonferroni
    chance: float

    @property
    def best(self) -> int:
        """The wave of the largest gain."""
        return int(np.argmax(self.gains))

    @property
    def rivals(self) -> Mask:
        """Which waves (w,) are like the best one, and explain the rows as well."""
        cross = self.matrix[:, :, self.best]
        of_best = self.covariances[self.best]
        likeness = np.einsum(
            "wij,wik,wkl,lj->w", cross, self.covariances, cross, of_best
        )
        rivals: Mask = likeness / 2.0 > WAVES.likeness
        rivals &= self.nats > self.nats[self.best] - WAVES.nats
        rivals[self.best] = False
        return rivals


def _fits_of(noise: NoiseFit, x: Array) -> WaveFits:
    """Fits of columns (N, w, 2) under a noise."""
    count = x.shape[1]
    columns = x.reshape(len(x), 2 * count)
    statistics = noise.nuisance.statistics(noise.system.y, columns)
    information, vector = statistics.information(noise.size)
    matrix = information.reshape(count, 2, count, 2)
    vector = vector.reshape(count, 2)
    waves = np.arange(count)
    blocks = matrix[waves, :, waves]
    covariances = np.asarray(np.linalg.pinv(blocks, hermitian=True), float)
    amplitudes = np.einsum("wij,wj->wi", covariances, vector)
    gains = (amplitudes * vector).sum(axis=1) / noise.correlation_time
    # a wave that explains a share g of y' C^-1 y gains -f / 2 log(1 - g)
    squares = noise.residual.ravel() @ noise.system.y / noise.size
    share = np.minimum(gains * noise.correlation_time / squares, 0.999)
    nats = -0.5 * noise.freedom * np.log1p(-share)
    chance = count * share_chance(float(share.max()), 2, noise.freedom)
    return WaveFits(matrix, covariances, amplitudes, gains, nats, chance)


def _clearest_wave(noise: NoiseFit) -> Wave | None:
    """The wave that explains most beside a noise, None where it may be chance."""
    system = noise.system
    indices = _indices_of_waves(system.reference)
    if not len(indices):
        return None
    fits = _fits_of(noise, system.columns[:, indices])
    if fits.chance >= FALSE_ALARM:
        return None
    best = fits.best
    amplitude = float(np.linalg.norm(fits.amplitudes[best]))
    is_larger = amplitude > WAVES.usual
    return Wave(indices[best], is_larger and not fits.rivals.any())


def _indices_of_waves(reference: Reference) -> Indices:
    """Parameters (w, 2) of cosine and sine of each further wave of each turning joint."""
    curves = indices_of(reference.structure, ("curve",))
    by_joint = curves.reshape(-1, 2, HARMONICS)
    indices = by_joint.swapaxes(1, 2).reshape(-1, 2)
    is_new = ~np.isin(indices[:, 0], reference.waves)
    return indices[is_new]


def _follows_short_waves(noise: NoiseFit) -> bool:
    """Whether the noise of a joint's encoder is a wave of the joint, too short for a curve.

    A curve has at most 48 cycles a turn; a strain wave gear has twice its ratio, such as 200.
    """
    system = noise.system
    if system.noisy_joint is None:
        return False
    joint, _ = system.noisy_joint
    observations = system.observations
    angles = observations.q[:, joint, None] * SHORT_WAVES
    waves = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    moves = system.slope[..., joint]
    columns = moves[:, :, None] * waves.reshape(len(waves), 1, -1)
    x = system.whiten(columns).reshape(moves.size, -1, 2)
    return _fits_of(noise, x).chance < FALSE_ALARM
