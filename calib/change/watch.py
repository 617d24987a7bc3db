"""A watch over a stream: whether distortion, links or positions leave what is usual (eq. 9).

`Watch` notices a change, `matching_sigma` says from which radius maps start again, and `Step` is
what a follower tells after some samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..maps.map import Map, search_tree
from ..model.model import Model

_WINDOW = 200.0  # samples that a running mean remembers
_FIRED = 4.0  # standard deviations of a running mean that are no chance
_SETTLED = 1.2  # a re-formed map has settled within this factor of a trained one
_JUMP = 3.0  # an error that rises by this factor while the maps re-form: another change
_NEIGHBOURS = 4  # earlier samples that a sample is compared with
_LOOSE = 1.5  # what a settled map's own distortion must be exceeded by
_TRACKING = 0.05  # share by which a settled map's usual means follow, per block


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
    changes: int = 0  # changes noticed so far


class Watch:
    """Running means of a stream, and what they may be.

    model : its baseline is what is usual

    Attributes
    ----------
    mean, block : dict of str to float
        ``motor`` and ``sensory`` distortion and ``error``: running means and those of the
        latest block.
    usual : dict of str to float
        The running means of maps that have settled after a change.
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        self._noise = model.baseline.noise if model.baseline else 0.0
        self._seen = 0
        self._apart = math.nan  # running mean of the distance to earlier samples
        self.mean: dict[str, float] = {}
        self.block: dict[str, float] = {}
        self.usual: dict[str, float] = {}

    def look(
        self, motor: Map, sensory: Map, u: Array, v: Array, error: float, reformed: bool
    ) -> float:
        """Update the means; return the sensory distortion that is to be expected.

        u, v : (n, dof), (n, m), samples in the unit boxes
        error : [unit], mean distance of the links' readout
        reformed : whether the maps have re-formed since training
        """
        model = self._model
        self._seen += len(u)
        share = min(1.0, len(u) / _WINDOW)
        distance, winner = (part[:, 0] for part in sensory.nearest(v))
        self.block = {
            "motor": float(np.mean(motor.nearest(u)[0] ** 2)),
            "sensory": float(np.mean(distance**2)),
            "error": error,
        }
        for name, value in self.block.items():
            self.mean[name] = (1 - share) * self.mean.get(name, value) + share * value
        if model.baseline is None:
            return math.inf
        chance = _FIRED * math.sqrt(model.baseline.spread[1] / _WINDOW)
        # distances scale with the lattice: a larger arm's nodes stand further apart
        size = (sensory.spacing / model.sensory.spacing) ** 2 * (_SETTLED if reformed else 1.0)
        expected = float(model.baseline.sensory[winner].mean()) * size * (1.0 + chance)
        # a map that follows is not trained anew: its own distortion is usual to it
        return max(expected, _LOOSE * self.usual.get("sensory", 0.0) * (1.0 + chance))

    def fired(self, expected: float) -> bool:
        """Whether the distortion (eq. 9) or the links' residual left what is usual."""
        errors = self._model.about.errors
        trained = errors["activity"]["forward"]["distance"]["mean"] if errors else math.inf
        usual = max(trained, self.usual.get("error", 0.0))
        return self._seen >= _WINDOW / 2 and (
            self.mean["sensory"] > expected or self.mean["error"] > 2.0 * (usual + self._noise)
        )

    def settle(self) -> None:
        """A settled map goes on at its last rates: what is usual to it follows slowly."""
        usual = self.usual or self.mean
        self.usual = {n: v + _TRACKING * (self.mean[n] - v) for n, v in usual.items()}

    def jumped(self, q: Array, x: Array, u: Array, v: Array) -> bool:
        """Whether positions contradict those of the nearest joints (k, dof), (k, m) before.

        It tells another change even while the links, which lag behind, are far off.
        """
        motor, sensory = self._model.motor.scale, self._model.sensory.scale
        _, near = search_tree(motor.to_unit(q), motor).query(u, k=np.arange(1, _NEIGHBOURS + 1))
        predicted = x[near].mean(axis=1)
        block = float(np.linalg.norm(predicted - sensory.from_unit(v), axis=1).mean())
        jump = block > _JUMP * self._apart + 2.0 * self._noise  # never where it is unknown
        if not jump:
            known = math.isfinite(self._apart)
            self._apart = 0.5 * (self._apart + block) if known else block
        return jump

    def reset(self) -> None:
        """A change was noticed: the latest block is all that counts."""
        self._apart = math.nan
        self.usual.clear()
        self.mean = dict(self.block)


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
