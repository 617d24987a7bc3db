"""Noise: its most likely size where all may have changed, one encoder's, play and waves of joints.

They are estimated before any test: as the noise is estimated, a group has the chance of an F test.

A wave of N cycles a turn, as gears and the discs of encoders make them, moves a joint by
a cos(N q) + b sin(N q), which are two parameters of the joint's curve.  Their columns X are tested
as any group's (`significance`)::

    g = y' C^-1 X (X' C^-1 X)^-1 X' C^-1 y,    g / f ~ Beta(1, f / 2 - 1)  where there is no wave

f are the degrees of freedom of the noise, which is estimated with the wave in it.  An encoder's
noise differs from row to row at one joint value; a wave does not.
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
        system, creep_share=CREEP_SHARE, change_sd=sd_of_changes(reference)
    )
    statistics = nuisance.statistics(system.y)
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
    joint, step = _noisiest_joint(noise.residual, slope, typical)

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
    residual: Array, slope: Array, typical: Array
) -> tuple[int, int]:
    """The joint j, and which of `JOINT_NOISES`, that makes residuals r (n, m) most likely.

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
    # what bends the joints, and couplings, would leave few rows no freedom
    bending = ("elastic", "payload", "coupling")
    sd[indices_of(reference.structure, bending)] = 0.0
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


def share_chance(share: float, count: int, freedom: float) -> float:
    """Chance (beta) that k columns explain so large a share of f squares where nothing changed.

    share ~ Beta(k / 2, (f - k) / 2)
    """
    from scipy.special import betainc

    rest = max(freedom - count, 1e-3)
    return float(betainc(rest / 2, count / 2, 1.0 - min(share, 1.0)))


def score_of(chance: float) -> float:
    """Logarithm of a chance over that of `FALSE_ALARM`: above 1 it is none."""
    chance = min(max(chance, 1e-300), 1.0)
    return abs(math.log(chance) / math.log(FALSE_ALARM))


# Least share of the squared residuals that a play explains: a wrist of a real UR10 that has none
# explained less in three of 252 checks
LEAST_EXPLAINED = 0.06


@dataclass(frozen=True)
class Play:
    """A joint that has more play than the model knows."""

    joint: int
    half: float  # half of its play [rad or m]
    deviation: float  # standard deviation of that
    score: float  # above 1: it is no chance

    def taken_up(self, observations: LogRows) -> LogRows:
        """The observations at the joints' true values under this play."""
        q = observations.q.copy()
        q[:, self.joint] -= self.half * observations.side[:, self.joint]
        return replace(observations, q=q)


def find_play(noise: NoiseFit) -> Play | None:
    """Find the joint whose play explains most besides all that may have changed; None for chance.

    A joint is off by half its play, towards the side from which it came.  Each row has
    f and r, what K does not follow of -slope * side and of the residual::

        half = sum f r / sum f^2,    statistic = (sum f r)^2 / sum (f r - mean f r)^2

    noise : of the log, given all that may have changed
    """
    system = noise.system
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
    # amplitude up to which an arm that has not changed may have a wave which its model has not
    # learned [rad]: all of a usual curve's rms in one
    usual: float = math.sqrt(2.0) * PRIOR.curve_rms
    # share of what a wave does from which another one does the same, and nats by which it has to
    # explain the rows less: rows in a corner do not distinguish waves of 8 and 9 cycles
    alike: float = 0.5
    nats: float = 5.0


WAVES = WaveSettings()
SHORT_WAVES = np.arange(HARMONICS + 1, 401)
"""Waves a turn that are no part of a curve, beyond those of usual gears."""


class Wave(NamedTuple):
    """A wave of one joint."""

    indices: Indices  # (2,), its parameters: of the cosine and of the sine
    # whether an arm that has not changed has none like it, and no other explains the rows as well
    is_cause: bool


def with_waves(noise: NoiseFit) -> NoiseFit:
    """A larger noise less the waves of joints, found one by one, the clearest first.

    A wave has to be no chance under the noise of one joint's encoder, too.
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
    # (w,), twice the gain in log likelihood of each over the noise
    gains: Array
    # (w,), gain in log likelihood where the noise is what each leaves
    nats: Array
    # of the largest gain where there is no wave, after Bonferroni
    chance: float

    @property
    def best(self) -> int:
        """The wave of the largest gain."""
        return int(np.argmax(self.gains))

    @property
    def rivals(self) -> Mask:
        """Which waves (w,) do much of what the best does, and explain the rows as well."""
        cross = self.matrix[:, :, self.best]
        of_best = self.covariances[self.best]
        alike = np.einsum(
            "wij,wik,wkl,lj->w", cross, self.covariances, cross, of_best
        )
        rivals: Mask = alike / 2.0 > WAVES.alike
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
    # of squares y' C^-1 y a wave explains a share g: log p = -f / 2 log(1 - g)
    squares = noise.residual.ravel() @ noise.system.y / noise.size
    share = np.minimum(gains * noise.correlation_time / squares, 0.999)
    nats = -0.5 * noise.freedom * np.log1p(-share)
    chance = count * share_chance(float(share.max()), 2, noise.freedom)
    return WaveFits(matrix, covariances, amplitudes, gains, nats, chance)


def _clearest_wave(noise: NoiseFit) -> Wave | None:
    """The wave of the least chance under a noise, None where that may be chance."""
    system = noise.system
    indices = _indices_of_waves(system.reference)
    if not len(indices):
        return None
    fits = _fits_of(noise, system.x[:, indices])
    if fits.chance >= FALSE_ALARM:
        return None
    best = fits.best
    amplitude = float(np.linalg.norm(fits.amplitudes[best]))
    is_larger = amplitude > WAVES.usual
    return Wave(indices[best], is_larger and not fits.rivals.any())


def _indices_of_waves(reference: Reference) -> Indices:
    """Parameters (w, 2) of each wave of each turning joint: of its cosine and of its sine."""
    curves = indices_of(reference.structure, ("curve",))
    curves = curves.reshape(-1, 2, HARMONICS)
    indices = np.swapaxes(curves, 1, 2).reshape(-1, 2)
    is_new = ~np.isin(indices[:, 0], reference.waves)
    return indices[is_new]


def _follows_short_waves(noise: NoiseFit) -> bool:
    """Whether what a joint's encoder is blamed for repeats with the joint, in waves too short.

    A curve has 48 at most; a strain wave gear has twice its ratio, such as 200.
    """
    system = noise.system
    if system.noisy is None:
        return False
    joint, _ = system.noisy
    observations = system.observations
    angles = observations.q[:, joint, None] * SHORT_WAVES
    waves = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    moves = system.slope[..., joint]
    columns = moves[:, :, None] * waves.reshape(len(waves), 1, -1)
    x = system.whiten(columns).reshape(moves.size, -1, 2)
    return _fits_of(noise, x).chance < FALSE_ALARM
