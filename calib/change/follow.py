"""Online adaptation, as in the paper: maps and links re-form while samples stream in.

For a stream that lasts: a change is noticed, followed, and the next one is waited for.
Equation numbers are those of the paper in the order in which it states them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..errors import OptionError
from ..maps import dsom
from ..maps.density import Visit, gain_of, kind_of
from ..maps.lattice import Lattice
from ..maps.links import oja, without_weak
from ..maps.map import Map
from ..maps.online import present_online
from ..model.model import Model
from .settled import settled_model
from .watch import Step, Watch, matching_sigma

HORIZON = 10_000
"""Samples over which a re-formed map settles: half of what training takes."""

BLOCK = 100
"""Samples between two looks at distortion, gain and search trees."""

_GLANCE = 5  # one sample in so many tells the error
_SIGMA_END = 0.5  # neighbourhood radius once settled [nodes]
_ALPHA = (0.5, 0.05)  # learning rate just after a reset and once settled
_ETA = 0.13  # eta_init of eq. 12: eta beta stays below 1, where eq. 11 is stable
_BETA = 1.0  # beta_init of eq. 12
_KEPT = 20_000  # latest samples that the local models are fitted to
_LARGEST = 60_000_000  # links that are held densely
_CALM = 3  # blocks after a reset before another change can be told from the first
_LEAST = 10  # samples since a change that a model can rest on


class OnlineAdapter:
    """A model that follows a stream of samples.

    It watches until the sensory distortion (eq. 9) or the links' residual leaves what
    training knew.  Then sigma is reset to the radius at which training had the same
    distortion (eq. 10), eta and beta rise (eq. 12), and all three decay while the maps
    (eq. 1 to 3) and the links (eq. 11) follow the samples.  Once they are settled it keeps
    their last rates and watches again: the next change resets the schedules and forgets
    the samples from before it.  So does a jump of the error while the maps re-form.

    model : where to start; it is left as it is
    horizon : samples over which sigma decays to half a node
    force : whether to adapt from the first sample on, without waiting for a signal, and to take all
        samples for those of one arm
    """

    def __init__(self, model: Model, horizon: int = HORIZON, *, force: bool = False) -> None:
        if horizon < 1:
            raise OptionError(f"horizon {horizon}: expected one or more samples")
        check_followable(model)
        if model.motor.size * model.sensory.size > _LARGEST:
            raise OptionError(
                f"lattices of {model.motor.size:,} and {model.sensory.size:,} nodes are too "
                "large for online adaptation, which holds every link: use `method='few-shot'`"
            )
        self._model = model
        self._horizon = horizon
        self._force = force
        self._weights = {n: getattr(model, n).units.copy() for n in ("motor", "sensory")}
        # by sensory node, so that the columns that eq. 11 changes are contiguous
        # half the memory of float64; eq. 11 loses nothing by it
        self._links: Any = np.ascontiguousarray(model.links.T.toarray(), dtype=np.float32)
        self._idle = np.zeros(model.sensory.size)  # what unvisited nodes should have forgotten
        self._seen = 0
        self._since = -1
        self._changes = 0
        self._watch = Watch(model)
        self._start = {"motor": _SIGMA_END, "sensory": _SIGMA_END}
        self._q: list[Array] = []
        self._x: list[Array] = []

    @property
    def adapting(self) -> bool:
        """Whether a change was noticed and the maps have not settled yet."""
        return self._since >= 0 and (self._force or self._since < self._horizon)

    @property
    def changes(self) -> int:
        """Changes noticed so far."""
        return self._changes

    def feed(self, q: Array, x: Array) -> Step:
        """Take the next samples of the stream, (n, dof) and (n, 2), and learn from them."""
        u = self._model.motor.scale.to_unit(np.asarray(q, dtype=float))
        v = self._model.sensory.scale.to_unit(np.asarray(x, dtype=float))
        if not len(u):
            raise OptionError("no samples: expected one or more rows")
        for first in range(0, len(u), BLOCK):
            step = self._feed(u[first : first + BLOCK], v[first : first + BLOCK])
        return step

    def _feed(self, u: Array, v: Array) -> Step:
        motor, sensory = self._map("motor"), self._map("sensory")
        some = slice(0, None, _GLANCE)
        gap = (self._say(motor, u[some]) - v[some]) * sensory.scale.span
        error = float(np.linalg.norm(gap, axis=1).mean())
        expected = self._watch.look(motor, sensory, u, v, error, self._since >= 0)
        self._seen += len(u)
        kept = slice(None)
        if self._changed(u, v, expected):
            self._reset()
            if not self._force:  # this block may have begun before the change
                kept = slice(0)
        sigma, eta, beta = (0.0, 0.0, 0.0) if self._since < 0 else self._learn(u, v, kept)
        mean = self._watch.mean
        return Step(
            self._seen, mean["motor"], mean["sensory"], expected, mean["error"], sigma, eta, beta,
            self.adapting, self._changes,
        )  # fmt: skip

    def _learn(self, u: Array, v: Array, kept: slice) -> tuple[float, float, float]:
        """Form maps and links by samples; sigma, eta and beta of the last one."""
        for name, network, points in (("motor", self._map("motor"), u),
                                      ("sensory", self._map("sensory"), v)):  # fmt: skip
            self._form(name, network, points)
        wiring = self._model.association.wiring
        t = np.minimum(self._since + np.arange(len(u)), self._horizon)
        beta = _BETA * np.exp(1.0 - t / self._horizon)  # eq. 12
        eta = _ETA * np.exp(1.0 - t / self._horizon)
        a = wiring.activity(self._map("motor"), u).toarray()
        b = wiring.activity(self._map("sensory"), v).toarray()
        for a_motor, a_sensory, e, f in zip(a, b, eta, beta, strict=True):
            oja(self._links.T, a_motor, a_sensory, float(e), float(f))  # eq. 11
        # eq. 11 forgets where a_j > 0 alone; a node that no sample visits forgets at the
        # mean pace of all, or a shortened arm would promise its old reach for ever
        self._idle += float(eta * beta @ (b**2).sum(axis=1)) / b.shape[1]
        self._idle[b.any(axis=0)] = 0.0
        self._since += len(u)
        self._q.append(self._model.motor.scale.from_unit(u)[kept])
        self._x.append(self._model.sensory.scale.from_unit(v)[kept])
        while sum(map(len, self._x)) - len(self._x[0]) >= _KEPT:
            del self._q[0], self._x[0]
        return float(self._sigma("sensory", t[-1:])[0]), float(eta[-1]), float(beta[-1])

    def model(self, links: Literal["rest", "rule"] = "rest") -> Model:
        """The model as it stands, with local models of the latest samples.

        links : {"rest", "rule"}, "rest": the links at which eq. 11 comes to rest for the samples
            since the change, in closed form.  Nodes that the stream has not visited since have
            none: what is no longer reached is no longer promised.  "rule": the links that eq. 11
            and 12 have made so far, step by step, which lag behind the maps; the readouts
            ``activity`` and ``winner`` then show what the rule itself reaches.
        """
        if self._since < 0 or sum(map(len, self._x)) < _LEAST:
            return self._model
        found = None
        if links == "rule":
            found = without_weak((self._links * np.exp(-self._idle)[:, None]).T)
        maps = self._map("motor"), self._map("sensory")
        return settled_model(
            self._model, *maps, np.concatenate(self._q), np.concatenate(self._x), found
        )

    def _map(self, name: str) -> Map:
        network: Map = getattr(self._model, name)
        return Map(self._weights[name], network.lattice, network.scale, network.history)

    def _say(self, motor: Map, u: Array) -> Array:
        """Readout ``activity`` of the dense links, (n, 2) in the sensory unit box."""
        a = self._model.association.wiring.activity(motor, u)
        k = a.nnz // len(u)
        nodes, weight = a.indices.reshape(-1, k), a.data.reshape(-1, k)
        strength = np.einsum("jnk,nk->nj", self._links[:, nodes], weight)
        strength *= np.exp(-self._idle)
        total = strength.sum(axis=1, keepdims=True)
        return np.asarray(strength @ self._weights["sensory"] / np.maximum(total, 1e-30))

    def _changed(self, u: Array, v: Array, expected: float) -> bool:
        """Whether the arm or the sensor has just changed."""
        watch = self._watch
        if self._since < 0:
            return self._force or watch.fired(expected)
        if self._force:  # all samples are of one arm
            return False
        settled = bool(watch.usual)
        if self._since >= self._horizon:
            watch.settle()
        if sum(map(len, self._x)) >= _CALM * BLOCK and watch.jumped(
            np.concatenate(self._q), np.concatenate(self._x), u, v
        ):
            return True
        return settled and watch.fired(expected)

    def _reset(self) -> None:
        """Set sigma to where training had the same distortion (eq. 10), forget what was."""
        self._since = 0
        self._changes += 1
        self._q.clear()
        self._x.clear()
        for name in self._start:
            network: Map = getattr(self._model, name)
            after = max(self._watch.mean[name], self._watch.block[name])
            self._start[name] = max(_SIGMA_END, matching_sigma(network, math.sqrt(after)))
        self._watch.reset()

    def _sigma(self, name: str, t: NDArray[np.int_]) -> Array:
        start = self._start[name]
        # eq. 10: exp(-(t + tau) / T) with T such that it ends at half a node
        return np.asarray(start * (_SIGMA_END / start) ** (t / self._horizon))

    def _form(self, name: str, network: Map, points: Array) -> None:
        t = np.minimum(self._since + np.arange(len(points)), self._horizon)
        share = t / self._horizon
        rate = _ALPHA[0] * (_ALPHA[1] / _ALPHA[0]) ** share
        rule = str(self._model.about.options.get("map", "vdsom"))
        assert isinstance(network.lattice, Lattice)  # noqa: S101 - checked at the start
        try:
            gain, kind = gain_of(rule), kind_of(rule)
        except OptionError:  # a function that the model file could not keep
            gain, kind = gain_of("vdsom"), "som"
        weights = self._weights[name] = self._weights[name].copy()
        if kind == "dsom":  # its rate and radius follow the distance, not time
            dsom.present_dsom(weights, network.lattice, points)
            return
        if gain is not None:
            distance, winner = network.nearest(points)
            before = network.units
            rate = rate * gain(
                Visit(float(share[-1]), winner[:, 0], distance[:, 0], before, network.lattice)
            )
        present_online(weights, network.lattice, points, self._sigma(name, t), rate)


def check_followable(model: Model) -> None:
    """Refuse a model whose maps have no lattice to re-form."""
    for part in (model.motor, model.sensory):
        if not isinstance(part.lattice, Lattice):
            raise OptionError(
                "online adaptation resets the neighbourhood radius of a lattice (eq. 10), and a "
                "growing neural gas has neither: its edges age by wins, so that a region which "
                "is no longer visited keeps its nodes; use method 'few-shot', or train with "
                "map 'vdsom', 'som' or 'dsom'"
            )


def follow(
    model: Model, q: Array, x: Array, *, horizon: int = HORIZON, force: bool = False
) -> Iterator[tuple[Step, OnlineAdapter]]:
    """Let a model follow a stream, block by block: the paper's adaptation curves.

    model : where to start
    q, x : (n, dof), (n, 2) [unit], samples in the order in which they come
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
        yield adapter.feed(q[first : first + BLOCK], x[first : first + BLOCK]), adapter
