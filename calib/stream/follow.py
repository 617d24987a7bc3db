"""Online adaptation, as in the paper: maps and links re-form while samples stream in."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..common.arrays import Array
from ..common.choices import MAPS
from ..common.rows import row_lengths
from ..errors import ModelError, OptionError
from ..maps.density import gain_of
from ..maps.lattice import Lattice
from ..maps.links import without_weak
from ..maps.map import Map
from ..maps.rates import Rates
from ..maps.vdsom import VDSOM, Layer
from ..model.model import Model
from .settle import settled_model

HORIZON = 10_000
"""Samples over which a re-formed map settles: half of what training takes."""

BLOCK = 100
"""Samples between two updates of distortion, gain and search trees."""


@dataclass(frozen=True)
class FollowSettings:
    """How a stream is followed."""

    # samples from one report of the error to the next
    glance: int = 5
    # neighbourhood radius once settled [nodes]
    sigma_end: float = 0.5
    # most samples, the latest ones, that the local models are fitted to
    latest: int = 20_000
    # fewest samples since a change that a model is fitted to
    least: int = 10
    # samples over which the weight of older ones in a running mean fades by a factor of e
    window: float = 200.0
    # distortion of a re-formed map over that of a trained one, below which it has settled
    at_rest: float = 1.2
    # deviation of a running mean that is a change [its sd]
    no_chance: float = 4.0
    # error of the links over that of an unchanged arm, beyond which the arm has changed
    unusual: float = 2.0
    # share of samples beyond a log's own 95 % bound, beyond which the arm has changed
    beyond: float = 0.5


FOLLOW = FollowSettings()


@dataclass(frozen=True)
class Step:
    """The state after some samples of the stream."""

    samples: int  # samples seen so far
    # running means of the squared distance to the winner, in the unit box (eq. 9)
    zeta_motor: float
    zeta_sensory: float
    # what the sensory distortion exceeds by chance next to never
    threshold: float
    error: float  # [unit], running mean of the error of ``activity`` before a sample was learned
    sigma: float  # [nodes], radius of the sensory map (eq. 10), 0 before a change was noticed
    eta: float  # learning rate of the links (eq. 12)
    beta: float  # their forgetting factor
    adapting: bool  # whether a change was noticed and the maps are re-forming


def matching_sigma(network: Map, error: float) -> float:
    """Neighbourhood radius [nodes] at which training had a quantization error (eq. 10).

    network : a map, whose history records how the error fell with sigma; the radii of its coarse
        lattices count as the same share of the full one
    error : root mean square distance to the winner after the change, in the unit box
    Returns float, the radius of the whole map where the error is larger than at the start.
    """
    nodes, sigma, past = network.history.T[:3]
    full = sigma * (network.lattice.size / nodes) ** (
        1 / len(network.lattice.shape)
    )
    # the error of an epoch is that of the radius before it
    past = past[1:]
    full = full[:-1]
    if not len(past) or error > past.max():
        return max(network.lattice.shape) / 2
    # the last epoch that was as bad
    epoch = int(np.flatnonzero(past >= error)[-1])
    if epoch + 1 == len(past) or past[epoch] == past[epoch + 1]:
        return float(full[epoch])
    before, after = past[epoch : epoch + 2]
    larger, smaller = full[epoch : epoch + 2]
    share = (before - error) / (before - after)
    return float(larger * (smaller / larger) ** share)


class OnlineAdapter:
    """A model that follows a stream of samples.

    It watches until the sensory distortion (eq. 9) or the links' residual leaves what
    training knew, or most samples are beyond the bound of a log: maps of many joints
    are too coarse for that.  Then sigma is reset to the radius at which training had the same
    distortion (eq. 10), eta and beta rise (eq. 12), and all three decay while the maps
    (eq. 1 to 3) and the links (eq. 11) follow the samples.  Once they are settled it keeps
    their last rates.

    horizon : samples over which sigma decays to half a node
    force : whether to adapt from the first sample on, and to take all samples for those of one arm
    """

    def __init__(
        self, model: Model, horizon: int = HORIZON, *, force: bool = False
    ) -> None:
        if horizon < 1:
            raise OptionError(
                f"horizon {horizon}: expected one or more samples"
            )
        if model.baseline is None:
            raise ModelError(
                "the model has no baseline of its distortions: train it again"
            )
        self._model = model
        self._baseline = model.baseline
        self._horizon = horizon
        self._force = force
        self._vdsom = _vdsom_of(model)
        self._seen = 0  # samples
        self._since = -1  # samples since a change was noticed, -1 before
        # radii of the motor and the sensory map from which sigma decays [nodes]
        self._starts = [FOLLOW.sigma_end, FOLLOW.sigma_end]
        # running means: distortions of the motor and the sensory map, the error, and the share of
        # samples beyond the bound
        self._mean: Array | None = None
        self._last_predicted: Array | None = (
            None  # (m,) of the last sample [unit]
        )
        # sensory distortion and error, as an unchanged arm would show them
        self._expected = np.zeros(2)
        # latest samples since the change, block by block
        self._q: list[Array] = []
        self._x: list[Array] = []

    @property
    def adapting(self) -> bool:
        """Whether a change was noticed and the maps have not settled yet."""
        return self._since >= 0 and (self._force or self._since < self._horizon)

    def feed(self, q: Array, x: Array) -> Step:
        """Take the next samples of the stream, (n, dof) and (n, m), and learn from them."""
        model = self._model
        q = np.asarray(q, float)
        x = np.asarray(x, float)
        u = model.motor.scale.to_unit(q)
        v = model.sensory.scale.to_unit(x)
        if not len(u):
            raise OptionError("no samples: expected one or more rows")
        steps = [
            self._feed(u[k : k + BLOCK], v[k : k + BLOCK])
            for k in range(0, len(u), BLOCK)
        ]
        return steps[-1]

    def _feed(self, u: Array, v: Array) -> Step:
        """Take one block, (n, dof) and (n, m) in the unit boxes."""
        motor, sensory = self._maps()
        zeta_motor = (motor.nearest(u)[0] ** 2).mean()  # eq. 9
        zeta_sensory = (sensory.nearest(v)[0] ** 2).mean()
        latest = np.array(
            [zeta_motor, zeta_sensory, self._error(u, v), self._beyond(u, v)]
        )
        expected = self._expected_at(u)
        if self._mean is None:
            self._mean = latest
            self._expected = expected
        weight = min(1.0, len(u) / FOLLOW.window)
        self._mean = self._mean + weight * (latest - self._mean)
        step = expected - self._expected
        self._expected = self._expected + weight * step
        threshold, largest_error = self._thresholds(sensory)
        self._seen += len(u)
        mean_motor, mean_sensory, error, beyond = self._mean.tolist()
        departed = (
            mean_sensory > threshold
            or error > largest_error
            or beyond > FOLLOW.beyond
        )
        if self._seen < FOLLOW.window / 2:
            departed = False

        rows = slice(None)
        if self._since < 0 and (self._force or departed):
            self._since = 0
            self._reset_sigma(np.maximum(self._mean, latest))
            if not self._force:  # this block may have begun before the change
                rows = slice(0)
        rates = (0.0, 0.0, 0.0)
        if self._since >= 0:
            rates = self._learn(u, v, rows)
        sigma, eta, beta = rates
        return Step(
            samples=self._seen,
            zeta_motor=mean_motor,
            zeta_sensory=mean_sensory,
            threshold=threshold,
            error=error,
            sigma=sigma,
            eta=eta,
            beta=beta,
            adapting=self.adapting,
        )

    def _error(self, u: Array, v: Array) -> float:
        """Mean distance [unit] of some samples from what maps and links predict."""
        u = u[:: FOLLOW.glance]
        v = v[:: FOLLOW.glance]
        residual = self._vdsom.predict(u) - v
        residual *= self._model.sensory.scale.span
        return float(row_lengths(residual).mean())

    def _beyond(self, u: Array, v: Array) -> float:
        """Share of some samples that are beyond the model's own bound on what a sensor reads.

        Where a clock is late they lie on the way from the last prediction to the next.
        """
        model = self._model
        if model.about.bound_of != "sensor reading":
            return 0.0
        predicted = model.predictor.value(u)
        last = self._last_predicted
        if last is None:
            last = predicted[0]
        self._last_predicted = predicted[-1]
        back = -np.diff(predicted, axis=0, prepend=last[None])
        residual = model.sensory.scale.from_unit(v) - predicted
        square = np.maximum((back**2).sum(axis=1), 1e-300)
        share = np.clip((residual * back).sum(axis=1) / square, 0.0, 1.0)
        distance = row_lengths(residual - share[:, None] * back)
        bound = model.expected_error(model.motor.scale.from_unit(u))
        return float(np.mean(distance > bound))

    def _reset_sigma(self, zeta: Array) -> None:
        """Start sigma where training had the same distortions of both maps (eq. 10)."""
        for k, network in enumerate((self._model.motor, self._model.sensory)):
            radius = matching_sigma(network, math.sqrt(zeta[k]))
            self._starts[k] = max(FOLLOW.sigma_end, radius)

    def _expected_at(self, u: Array) -> Array:
        """Sensory distortion and error of an unchanged arm at joints (n, dof) in the unit box.

        Where these are counts: along a path, or at rest, both may be twice those of all joints.
        """
        model = self._model
        span = model.sensory.scale.span
        v = model.sensory.scale.to_unit(model.predictor.value(u))
        noise = self._baseline.noise
        distance, _ = model.sensory.nearest(v)
        noise_in_box = noise / span
        zeta = (distance**2).mean()
        zeta += (noise_in_box**2).sum()
        rows = slice(None, None, FOLLOW.glance)
        residual = model.association.forward(u[rows], "activity")
        residual -= v[rows]
        residual *= span
        error = row_lengths(residual).mean()
        return np.array([zeta, error + noise])

    def _thresholds(self, sensory: Map) -> tuple[float, float]:
        """Sensory distortion and error that an unchanged arm exceeds by chance next to never."""
        variance = self._baseline.spread[1] / FOLLOW.window
        chance = 1.0 + FOLLOW.no_chance * math.sqrt(variance)
        # distances scale with the lattice: a larger arm's nodes are further apart
        size = (sensory.spacing / self._model.sensory.spacing) ** 2
        at_rest = FOLLOW.at_rest if self._since >= 0 else 1.0
        zeta, error = self._expected.tolist()
        largest_zeta = zeta * size * at_rest * chance
        return largest_zeta, FOLLOW.unusual * error

    def _learn(
        self, u: Array, v: Array, rows: slice
    ) -> tuple[float, float, float]:
        """Form maps and links by samples; sigma, eta and beta of the last one.

        rows : of the samples that the model is to rest on
        """
        t = self._since + np.arange(len(u))
        rates = Rates.following(
            t, self._starts, FOLLOW.sigma_end, self._horizon
        )  # eq. 10, 12
        self._vdsom.show((u, v), rates)
        self._since += len(u)
        q = self._model.motor.scale.from_unit(u)
        x = self._model.sensory.scale.from_unit(v)
        self._q.append(q[rows])
        self._x.append(x[rows])
        while sum(map(len, self._x)) - len(self._x[0]) >= FOLLOW.latest:
            del self._q[0], self._x[0]
        return (
            float(rates.sigma[1][-1]),
            float(rates.eta[-1]),
            float(rates.beta[-1]),
        )

    def model(self, links: Literal["rest", "rule"] = "rest") -> Model:
        """The current model, with local models of the latest samples.

        links : {"rest", "rule"}, "rest": those at which eq. 11 comes to rest for the samples since
            the change: what is no longer reached is no longer promised.  "rule": those that eq. 11
            and 12 have made so far, step by step, which lag behind the maps
        """
        if self._since < 0 or sum(map(len, self._x)) < FOLLOW.least:
            return self._model
        rule_links = (
            without_weak(self._vdsom.links) if links == "rule" else None
        )
        q = np.concatenate(self._q)
        x = np.concatenate(self._x)
        return settled_model(self._model, *self._maps(), q, x, rule_links)

    def _maps(self) -> tuple[Map, Map]:
        """The motor and the sensory map as they are."""
        motor, sensory = self._vdsom.layers
        return (
            replace(self._model.motor, units=motor.weights),
            replace(self._model.sensory, units=sensory.weights),
        )


def _vdsom_of(model: Model) -> VDSOM:
    """The maps and links of a model as a VDSOM that learns on."""
    # a model file keeps no function
    rule = str(model.about.options.get("map", "vdsom"))
    gain = gain_of(rule if rule in MAPS else "vdsom")
    layers = []
    for network in (model.motor, model.sensory):
        lattice = network.lattice
        if not isinstance(lattice, Lattice):
            raise OptionError(
                "online adaptation resets the neighbourhood radius of a lattice (eq. 10), and "
                "a growing neural gas has neither: use method 'few-shot', or train with map "
                "'vdsom', 'som' or 'dsom'"
            )
        layers.append(Layer(network.units, lattice, network.scale, gain))
    return VDSOM(layers, model.association.wiring, model.links.toarray())


def follow(
    model: Model,
    q: Array,
    x: Array,
    *,
    horizon: int = HORIZON,
    force: bool = False,
) -> Iterator[tuple[Step, OnlineAdapter]]:
    """Let a model follow a stream, block by block: the paper's adaptation curves.

    model : where to start
    q, x : (n, dof), (n, m) [unit], samples in the order in which they come
    horizon, force : see :class:`OnlineAdapter`

    Yields
    ------
    step : Step
        Distortion, error and schedules after each block.
    adapter : OnlineAdapter
        ``adapter.model()`` is the model at that point.
    """
    adapter = OnlineAdapter(model, horizon, force=force)
    for first in range(0, len(q), BLOCK):
        block = slice(first, first + BLOCK)
        yield adapter.feed(q[block], x[block]), adapter
