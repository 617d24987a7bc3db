"""Online adaptation, as in the paper: maps and links re-form while samples stream in.

For a stream that lasts: a change is noticed, followed, and the next one is waited for.
Equation numbers are those of the paper in the order in which it states them.
:class:`~calib.change.streams.Follower` adds schemas that are kept and recalled.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError
from ..maps import dsom
from ..maps.association import Association
from ..maps.density import Visit, gain_of, kind_of
from ..maps.lattice import Lattice
from ..maps.links import oja, sparse_links
from ..maps.local_models import NO_MODELS
from ..maps.map import Map, search_tree
from ..maps.model_selection import blocks
from ..maps.online import present
from ..maps.predictor import Predictor
from ..model.rows import Rows
from ..training.log_bounds import node_bounds
from .radius import matching_sigma
from .refit import Refit, refit

if TYPE_CHECKING:
    from ..model.model import Model

Array = NDArray[np.float64]

HORIZON = 10_000
"""Samples over which a re-formed map settles: half of what training takes."""

BLOCK = 100
"""Samples between two looks at distortion, gain and search trees."""

_GLANCE = 5  # one sample in so many tells the error
_WINDOW = 200.0  # samples that a running mean remembers
_SIGMA_END = 0.5  # neighbourhood radius once settled [nodes]
_ALPHA = (0.5, 0.05)  # learning rate just after a reset and once settled
_ETA = 0.13  # eta_init of eq. 12: eta beta stays below 1, where eq. 11 is stable
_BETA = 1.0  # beta_init of eq. 12
_KEPT = 20_000  # latest samples that the local models are fitted to
_FIRED = 4.0  # standard deviations of a running mean that are no chance
_SETTLED = 1.2  # a re-formed map has settled within this factor of a trained one
_LARGEST = 60_000_000  # links that are held densely
_JUMP = 3.0  # an error that rises by this factor while the maps re-form: another change
_CALM = 3  # blocks after a reset before another change can be told from the first
_NEIGHBOURS = 4  # earlier samples that a sample is compared with
_LOOSE = 1.5  # what a settled map's own distortion must be exceeded by
_TRACKING = 0.05  # share by which a settled map's usual means follow, per block
_LEAST = 10  # samples since a change that a model can rest on


@dataclass(frozen=True)
class Step:
    """The state after some samples of the stream.

    Attributes
    ----------
    samples : int
        Samples seen so far.
    zeta_motor, zeta_sensory : float
        Distortion of the maps (eq. 9): running mean of the squared distance to the
        winner, in the unit box.
    threshold : float
        What the sensory distortion exceeds by chance next to never.
    error : float [unit]
        Running mean of the distance from each sample to what the readout ``activity``
        said of it before it was learned.
    sigma : float [nodes]
        Neighbourhood radius of the sensory map (eq. 10), 0 before a change was noticed.
    eta, beta : float
        Learning rate and forgetting factor of the links (eq. 12).
    adapting : bool
        Whether a change was noticed and the maps are re-forming.
    changes : int
        Changes noticed so far.
    """

    samples: int
    zeta_motor: float
    zeta_sensory: float
    threshold: float
    error: float
    sigma: float
    eta: float
    beta: float
    adapting: bool
    changes: int = 0


class OnlineAdapter:
    """A model that follows a stream of samples.

    It watches until the sensory distortion (eq. 9) or the links' residual leaves what
    training knew.  Then sigma is reset to the radius at which training had the same
    distortion (eq. 10), eta and beta rise (eq. 12), and all three decay while the maps
    (eq. 1 to 3) and the links (eq. 11) follow the samples.  Once they are settled it keeps
    their last rates and watches again: the next change resets the schedules and forgets
    the samples from before it.  So does a jump of the error while the maps re-form.

    Parameters
    ----------
    model : Model
        Where to start; it is left as it is.
    horizon : int
        Samples over which sigma decays to half a node.
    force : bool
        Whether to adapt from the first sample on, without waiting for a signal, and to
        take all samples for those of one arm.
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
        self._mean: dict[str, float] = {}
        self._block: dict[str, float] = {}
        self._usual: dict[str, float] = {}  # running means once settled
        self._apart = math.nan  # running mean of what :meth:`_contradiction` finds
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
        step = None
        for first in range(0, len(u), BLOCK):
            step = self._feed(u[first : first + BLOCK], v[first : first + BLOCK])
        if step is None:
            raise OptionError("no samples: expected one or more rows")
        return step

    def _feed(self, u: Array, v: Array) -> Step:
        motor, sensory = self._map("motor"), self._map("sensory")
        expected = self._watch(motor, sensory, u, v)
        self._seen += len(u)
        kept = slice(None)
        if self._changed(u, v, expected):
            self._reset()
            # this block may have begun before the change
            kept = slice(None) if self._force else slice(0)
        if self._since < 0:
            return self._step(expected, 0.0, 0.0, 0.0)
        for name, network, points in (("motor", motor, u), ("sensory", sensory, v)):
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
        scale = self._model.sensory.scale
        self._q.append(self._model.motor.scale.from_unit(u)[kept])
        self._x.append(scale.from_unit(v)[kept])
        while sum(map(len, self._x)) - len(self._x[0]) >= _KEPT:
            del self._q[0], self._x[0]
        return self._step(expected, self._sigma("sensory", t[-1:])[0], eta[-1], beta[-1])

    def model(self, links: Literal["rest", "rule"] = "rest") -> Model:
        """The model as it stands, with local models of the latest samples.

        Parameters
        ----------
        links : {"rest", "rule"}
            "rest": the links at which eq. 11 comes to rest for the samples since the
            change, in closed form.  Nodes that the stream has not visited since have none:
            what is no longer reached is no longer promised.  "rule": the links that eq. 11
            and 12 have made so far, step by step, which lag behind the maps; the readouts
            ``activity`` and ``winner`` then show what the rule itself reaches.
        """
        model = self._model
        if self._since < 0 or sum(map(len, self._x)) < _LEAST:
            return model
        motor, sensory = self._map("motor"), self._map("sensory")
        q, x = np.concatenate(self._q), np.concatenate(self._x)
        # a short stream may have been shown again and again
        first = np.sort(np.unique(np.hstack([q, x]), axis=0, return_index=True)[1])
        u, x = motor.scale.to_unit(q[first]), x[first]
        fitted = refit(model, motor, u, x)
        wiring = model.association.wiring
        if links == "rule":
            found = sparse_links((self._links * np.exp(-self._idle)[:, None]).T)
            association = Association(motor, sensory, found, wiring)
        else:
            v = sensory.scale.to_unit(fitted.v)
            association = Association.learn(motor, fitted.u, sensory, v, wiring)
        if model.default_readout == "linear":  # maps and links, without anything else
            fitted = _alone(fitted, association, u, x)
        made = replace(
            model,
            association=association,
            predictor=fitted.predictor,
            body=fitted.body,
            visited=np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0,
            rows=Rows.of(motor.scale.from_unit(u), x) if model.rows is not None else None,
        )
        has_models = fitted.predictor.models.degree >= 0
        reading, position = node_bounds(made, u, fitted.rows, fitted.errors, has_models=has_models)
        true = model.about.bound_of == "true position"
        return replace(made, bounds=position if true else reading, model_bounds=position)

    def _map(self, name: str) -> Map:
        network: Map = getattr(self._model, name)
        return Map(self._weights[name], network.lattice, network.scale, network.history)

    def _watch(self, motor: Map, sensory: Map, u: Array, v: Array) -> float:
        """Update the running means; return the sensory distortion that is to be expected."""
        model = self._model
        share = min(1.0, len(u) / _WINDOW)
        distance, winner = (part[:, 0] for part in sensory.nearest(v))
        some = slice(0, None, _GLANCE)
        gap = (self._say(motor, u[some]) - v[some]) * sensory.scale.span
        found = {
            "motor": float(np.mean(motor.nearest(u)[0] ** 2)),
            "sensory": float(np.mean(distance**2)),
            "error": float(np.linalg.norm(gap, axis=1).mean()),
        }
        self._block = found
        for name, value in found.items():
            self._mean[name] = (1 - share) * self._mean.get(name, value) + share * value
        if model.baseline is None:
            return math.inf
        chance = _FIRED * math.sqrt(model.baseline.spread[1] / _WINDOW)
        # distances scale with the lattice: a larger arm's nodes stand further apart
        size = (sensory.spacing / model.sensory.spacing) ** 2
        size *= _SETTLED if self._since >= 0 else 1.0
        expected = float(model.baseline.sensory[winner].mean()) * size * (1.0 + chance)
        # a map that follows is not trained anew: its own distortion is usual to it
        return max(expected, _LOOSE * self._usual.get("sensory", 0.0) * (1.0 + chance))

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
        if self._since < 0:
            return self._force or self._fired(expected)
        if self._force:  # all samples are of one arm
            return False
        settled = bool(self._usual)
        if self._since >= self._horizon:
            # a settled map goes on at its last rates: what is usual to it follows slowly
            usual = self._usual or self._mean
            self._usual = {n: v + _TRACKING * (self._mean[n] - v) for n, v in usual.items()}
        block = self._contradiction(u, v)
        jump = block > _JUMP * self._apart + 2.0 * self._noise  # never where it is unknown
        if not jump and math.isfinite(block):
            known = math.isfinite(self._apart)
            self._apart = 0.5 * (self._apart + block) if known else block
        return jump or (settled and self._fired(expected))

    def _contradiction(self, u: Array, v: Array) -> float:
        """Mean distance of positions to those of the nearest joints since the change [unit].

        It tells another change even while the links, which lag behind, are far off.
        """
        if sum(map(len, self._x)) < _CALM * BLOCK:
            return math.nan
        motor, sensory = self._model.motor.scale, self._model.sensory.scale
        past = motor.to_unit(np.concatenate(self._q))
        _, near = search_tree(past, motor).query(u, k=np.arange(1, _NEIGHBOURS + 1))
        said = np.concatenate(self._x)[near].mean(axis=1)
        return float(np.linalg.norm(said - sensory.from_unit(v), axis=1).mean())

    def _fired(self, expected: float) -> bool:
        """Whether the distortion (eq. 9) or the links' residual left what is usual."""
        errors = self._model.about.errors
        trained = errors["activity"]["forward"]["distance"]["mean"] if errors else math.inf
        usual = max(trained, self._usual.get("error", 0.0))
        return self._seen >= _WINDOW / 2 and (
            self._mean["sensory"] > expected or self._mean["error"] > 2.0 * (usual + self._noise)
        )

    @property
    def _noise(self) -> float:
        return self._model.baseline.noise if self._model.baseline else 0.0

    def _reset(self) -> None:
        """Set sigma to where training had the same distortion (eq. 10), forget what was."""
        self._since, self._apart = 0, math.nan
        self._changes += 1
        self._q.clear()
        self._x.clear()
        self._usual.clear()
        for name in self._start:
            network: Map = getattr(self._model, name)
            after = max(self._mean[name], self._block[name])
            self._start[name] = max(_SIGMA_END, matching_sigma(network, math.sqrt(after)))
        self._mean = dict(self._block)

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
        if kind == "dsom":  # its rate and radius follow the distance, not time
            self._weights[name] = weights = self._weights[name].copy()
            dsom.present(weights, network.lattice, points)
            return
        weights = self._weights[name]
        if gain is not None:
            distance, winner = network.nearest(points)
            visit = Visit(float(share[-1]), winner[:, 0], distance[:, 0], weights, network.lattice)
            rate = rate * gain(visit)
        self._weights[name] = weights = weights.copy()
        present(weights, network.lattice, points, self._sigma(name, t), rate)

    def _step(self, expected: float, sigma: float, eta: float, beta: float) -> Step:
        return Step(
            self._seen,
            self._mean["motor"],
            self._mean["sensory"],
            expected,
            self._mean["error"],
            float(sigma),
            float(eta),
            float(beta),
            self.adapting,
            self._changes,
        )


def _alone(fitted: Refit, association: Association, u: Array, x: Array) -> Refit:
    """The readout ``linear`` in place of what was fitted, and its errors on unseen blocks."""
    motor, sensory, wiring = association.motor, association.sensory, association.wiring
    folds = blocks(len(u))
    errors, rows = [], []
    for half in (0, 1):
        held = np.concatenate(folds[half::2])
        seen = np.concatenate(folds[1 - half :: 2])
        other = Association.learn(motor, u[seen], sensory, sensory.scale.to_unit(x[seen]), wiring)
        errors.append(np.linalg.norm(other.linear.value(u[held]) - x[held], axis=1))
        rows.append(held)
    predictor = Predictor(motor, association.linear, NO_MODELS)
    return replace(
        fitted, predictor=predictor, rows=np.concatenate(rows), errors=np.concatenate(errors)
    )


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

    Parameters
    ----------
    model : Model
        Where to start.
    q, x : (n, dof), (n, 2) array [rad or m], [unit]
        Samples in the order in which they come.
    horizon, force
        See :class:`OnlineAdapter`.

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
