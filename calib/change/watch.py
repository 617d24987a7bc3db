"""A watch over a stream: whether distortion, links or positions leave what is usual (eq. 9).

`Watch` notices a change, `matching_sigma` says from which radius maps start again, and `Step` is
what a follower tells after some samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..maps.map import Map
from ..model.model import Model

_WINDOW = 200.0  # samples that a running mean remembers
_SETTLED = 1.2  # a re-formed map has settled within this factor of a trained one
_FIRED = 4.0  # standard deviations of a running mean that are no chance


@dataclass(frozen=True)
class Step:
    """The state after some samples of the stream."""

    samples: int  # samples seen so far
    # distortion of the maps (eq. 9): running mean of the squared distance to the winner, in the
    # unit box.
    zeta_motor: float
    zeta_sensory: float
    threshold: float  # what the sensory distortion exceeds by chance next to never
    # [unit], running mean of the distance from each sample to what the readout ``activity`` said of
    # it before it was learned
    error: float
    # [nodes], neighbourhood radius of the sensory map (eq. 10), 0 before a change was noticed.
    sigma: float
    # learning rate and forgetting factor of the links (eq. 12).
    eta: float
    beta: float
    adapting: bool  # whether a change was noticed and the maps are re-forming


class Watch:
    """Running means of a stream, and what they may be: `model`'s baseline is what is usual.

    ``mean`` and ``block`` hold ``motor`` and ``sensory`` distortion and ``error``: running means
    and those of the latest block.
    """

    def __init__(self, model: Model) -> None:
        self._model, self._seen = model, 0
        self.mean: dict[str, float] = {}
        self.block: dict[str, float] = {}

    def look(
        self, motor: Map, sensory: Map, u: Array, v: Array, error: float, reformed: bool
    ) -> float:
        """Update the means; return the sensory distortion that is to be expected.

        u, v : (n, dof), (n, m), samples in the unit boxes
        error : [unit], mean distance of the links' readout
        reformed : whether the maps have re-formed since training
        """
        baseline = self._model.baseline
        self._seen += len(u)
        share = min(1.0, len(u) / _WINDOW)
        distance, winner = (part[:, 0] for part in sensory.nearest(v))
        squares = np.mean(motor.nearest(u)[0] ** 2), np.mean(distance**2)
        self.block = {"motor": float(squares[0]), "sensory": float(squares[1]), "error": error}
        for name, value in self.block.items():
            self.mean[name] = (1 - share) * self.mean.get(name, value) + share * value
        if baseline is None:
            return math.inf
        chance = _FIRED * math.sqrt(baseline.spread[1] / _WINDOW)
        # distances scale with the lattice: a larger arm's nodes stand further apart
        size = (sensory.spacing / self._model.sensory.spacing) ** 2
        size *= _SETTLED if reformed else 1.0
        return float(baseline.sensory[winner].mean()) * size * (1.0 + chance)

    def fired(self, expected: float) -> bool:
        """Whether the distortion (eq. 9) or the links' residual left what is usual."""
        errors, baseline = self._model.about.errors, self._model.baseline
        usual = errors["activity"]["forward"]["distance"]["mean"] if errors else math.inf
        usual += baseline.noise if baseline else 0.0
        far = self.mean["sensory"] > expected or self.mean["error"] > 2.0 * usual
        return self._seen >= _WINDOW / 2 and far


def matching_sigma(network: Map, error: float) -> float:
    """Neighbourhood radius [nodes] at which training had a quantization error (eq. 10).

    network : its history tells how the error fell with sigma; the radii of its coarse lattices
        count as the same share of the full one
    error : root mean square distance to the winner after the change, in the unit box
    Returns float, the radius of the whole map where the error is larger than at the start.
    """
    dim = len(network.lattice.shape)
    side = network.lattice.size ** (1 / dim)
    nodes, sigma, past = network.history[:, 0], network.history[:, 1], network.history[:, 2]
    full = sigma * side / nodes ** (1 / dim)
    # the error of an epoch is that of the radius before it
    past, full = past[1:], full[:-1]
    if not len(past) or error > past.max():
        return max(network.lattice.shape) / 2
    # the last epoch that was as bad
    epoch = int(np.flatnonzero(past >= error)[-1])
    if epoch + 1 == len(past) or past[epoch] == past[epoch + 1]:
        return float(full[epoch])
    share = (past[epoch] - error) / (past[epoch] - past[epoch + 1])
    return float(full[epoch] * (full[epoch + 1] / full[epoch]) ** share)
