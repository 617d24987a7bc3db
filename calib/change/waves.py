"""Waves: ripples of single joints that a log shows, as gears and the discs of encoders make them.

A wave of N cycles a turn moves a joint by a cos(N q) + b sin(N q), which are two parameters of the
joint's curve.  Their columns X are tested as any group's (`significance`)::

    g = y' C^-1 X (X' C^-1 X)^-1 X' C^-1 y,    g / f ~ Beta(1, f / 2 - 1)  where there is no wave

f are the degrees of freedom of the noise, which is estimated with the wave in it.

An encoder's noise differs from row to row at one joint value; a wave does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.curves import HARMONICS
from ..body.parameters import Indices
from ..body.settings import PRIOR
from ..common.arrays import Array, Mask
from .frame import Reference
from .noise import FALSE_ALARM, NoiseFit, noise_of, noise_with_joint
from .system import System


@dataclass(frozen=True)
class WaveSettings:
    """When a joint has a wave."""

    # most waves of a log
    most: int = 6
    # amplitude up to which an arm that has not changed may have a wave which its model has not
    # learned [rad]: all of a usual curve's rms in one
    usual: float = math.sqrt(2.0) * PRIOR.curve_rms
    # standard deviations by which it has to be larger
    clear: float = 2.0
    # share of what a wave does from which another one does the same, and nats by which it has to
    # explain the rows less: rows in a corner do not distinguish waves of 8 and 9 cycles
    alike: float = 0.5
    nats: float = 5.0


WAVES = WaveSettings()
SHORT_WAVES = np.arange(HARMONICS + 1, 401)
"""Waves a turn that are no part of a curve, beyond those of usual gears."""


@dataclass(frozen=True)
class Wave:
    """A wave of one joint."""

    indices: Indices  # (2,), its parameters: of the cosine and of the sine
    amplitude: float  # [rad]
    deviation: float  # standard deviation of that
    is_ambiguous: bool  # whether another wave explains the rows as well

    @property
    def is_cause(self) -> bool:
        """Whether it is one that an arm which has not changed does not have."""
        least = self.amplitude - WAVES.clear * self.deviation
        return least > WAVES.usual and not self.is_ambiguous


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
        own = self.covariances[self.best]
        alike = np.einsum(
            "wij,wik,wkl,lj->w", cross, self.covariances, cross, own
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
    # of f squares of a mean of 1 a wave explains g: log p = -f / 2 log(1 - g / f); of noise alone
    # so large a share has the chance (1 - g / f)^(f / 2 - 1)
    share = np.minimum(gains / noise.freedom, 0.999)
    nats = -0.5 * noise.freedom * np.log1p(-share)
    freedom = max(noise.freedom - 2.0, 0.0)
    chance = count * float(1.0 - share.max()) ** (freedom / 2.0)
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
    variance = float(np.trace(fits.covariances[best])) / 2.0
    return Wave(
        indices=indices[best],
        amplitude=float(np.linalg.norm(fits.amplitudes[best])),
        deviation=math.sqrt(variance * noise.correlation_time),
        is_ambiguous=bool(fits.rivals.any()),
    )


def _indices_of_waves(reference: Reference) -> Indices:
    """Parameters (w, 2) of each wave of each turning joint: of its cosine and of its sine."""
    groups = reference.structure.groups
    curves = [groups[name] for name in groups if name.startswith("curve")]
    pairs = [curve.reshape(2, -1).T for curve in curves]
    indices = np.concatenate(pairs)
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
