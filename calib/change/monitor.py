"""The monitor: one sample at a time, in constant memory, whether the map still fits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from ..maps.node_cells import NodeCells
from .group_tests import groups_of
from .seen import seen_body

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..maps.map import Map
    from ..model.model import Model

Array = NDArray[np.float64]

WINDOW = 200.0
"""Samples that the monitor remembers: older ones fade by a factor of e."""

FALSE_ALARM = 1e-6
"""Share of the samples of an undisturbed stream that raise an alarm, nominally."""

_COLLINEAR = 1e-3  # directions that are so much weaker than the strongest are left out
_DIRECTIONS = 8  # strongest displacements that are watched: a few microseconds each
_GRAIN = 1e-6  # share of the extent below which nothing counts as drift
_WARM = 20  # samples before the first judgement
_MOST, _DOUBTED = 100.0, 4.0  # largest ratio of distortions, of a sample that is clipped
_CLIP = 8.0  # a residual counts for at most so many standard deviations of the recent ones


class State(NamedTuple):
    """What is known after a sample.

    Attributes
    ----------
    samples : int
        Samples seen, without those outside of what the model has learned.
    drifted : bool
        Whether a signal is above its threshold now.
    score : float
        Largest value over threshold; 0 while there are too few samples.
    zeta : float
        Distortion of the sensory map (eq. 9) over what is expected where the samples lie.
    links : float [unit]
        Root mean square of the systematic part of the recent residuals.
    noise : float [unit]
        Standard deviation per axis of the rest.
    fired : tuple of str
        "sensory", "links", or both.
    """

    samples: int
    drifted: bool
    score: float
    zeta: float
    links: float
    noise: float
    fired: tuple[str, ...]


class Monitor:
    """Watches a stream of samples.

    Of the recent past it keeps means alone: of the sensory distortion over its expected
    value, and of the products of the residual with the displacements that a change of a link,
    an offset or the sensor's frame would make, those that `check` tests.

    Parameters
    ----------
    model : Model
        The map to watch.
    window : float
        Samples that are remembered.

    Examples
    --------
    >>> import calib
    >>> arm = calib.load_arm("two_link")
    >>> model = calib.train(calib.babble(arm, 500, noise=1e-3), size=10)
    >>> monitor = model.monitor()
    >>> calm = calib.babble(arm, 50, seed=1, noise=1e-3)
    >>> for q, x in zip(calm.q, calm.x):
    ...     state = monitor.update(q, x)
    >>> state.drifted
    False
    """

    def __init__(self, model: Model, window: float = WINDOW) -> None:
        baseline = model.baseline
        if baseline is None:
            raise ModelError("the model has no baseline of its distortions: train it again")
        motor, sensory = model.motor, model.sensory
        self._lower, self._span = motor.scale.lower, motor.scale.span
        self._periodic = motor.scale.periodic
        self._origin, self._size = sensory.scale.lower, sensory.scale.span
        self._motor, self._sensory = _Search(motor), _Search(sensory)
        self._units = motor.units
        self._expected = baseline.sensory
        self._taylor = _second_order(model)
        self._reach = 3.0 * motor.spacing
        self._visited = model.visited
        self._directions = _directions(model)
        self._fade = 1.0 - 1.0 / window
        p = self._directions.shape[2]
        self._moments = np.zeros((p, p))
        self._products = np.zeros(p)
        self._power = self._weight = self._square = 0.0
        self._ratio = self._usual = 0.0
        self._floor = _own_error(model)
        self._spread = baseline.spread[1]
        self._noise = max(baseline.noise, self._floor)
        self._quantile = _chi_square(p)
        self._samples = 0
        self._state = State(0, False, 0.0, 0.0, 0.0, 0.0, ())

    def update(self, q: Sequence[float] | Array, x: Sequence[float] | Array) -> State:
        """Take one sample, joints (dof,) [rad or m] and position (2,) [unit].

        A sample that is not finite or outside of what the model has learned changes nothing.
        """
        joints, position = np.asarray(q, dtype=float), np.asarray(x, dtype=float)
        u = (joints - self._lower) / self._span
        if self._periodic.any():
            u = np.where(self._periodic, u % 1.0, u)
        if not math.isfinite(float(u.sum()) + float(position.sum())):
            return self._state
        distance, node = self._motor.nearest(u)
        if distance > self._reach or not self._visited[node]:
            return self._state
        value, slope, bend = self._taylor
        z = u - self._units[node]
        z -= self._periodic * np.rint(z)
        said = value[node] + (slope[node] + bend[node] @ z) @ z
        residual = position - said
        size = math.hypot(residual[0], residual[1])
        usual = self._usual or self._noise
        self._usual = usual + 0.05 * (min(size, 3.0 * usual) - usual)
        most = _MOST
        if size > _CLIP * max(usual, self._noise):
            residual *= _CLIP * max(usual, self._noise) / size
            most = _DOUBTED
        away, winner = self._nearest((position - self._origin) / self._size)
        fade = self._fade
        phi = self._directions[node]
        self._moments *= fade
        self._moments += phi.T @ phi
        self._products *= fade
        self._products += residual @ phi
        self._power = fade * self._power + residual[0] ** 2 + residual[1] ** 2
        self._weight = fade * self._weight + 1.0
        self._square = fade * fade * self._square + 1.0
        ratio = min(away * away / self._expected[winner], most)
        self._ratio = fade * self._ratio + ratio
        self._samples += 1
        if self._samples >= _WARM:
            self._judge()
        else:
            self._state = self._state._replace(samples=self._samples)
        return self._state

    def _nearest(self, v: Array) -> tuple[float, int]:
        return self._sensory.nearest(v)

    @property
    def state(self) -> State:
        """The state after the last sample."""
        return self._state

    def _judge(self) -> None:
        p = len(self._moments)
        weight = self._weight
        gram = self._moments / weight
        gram.flat[:: p + 1] += 1e-9 * gram.trace() / p
        mean = self._products / weight
        explained = float((mean * np.linalg.solve(gram, mean)).sum())
        power = self._power / weight
        independent = weight * weight / self._square
        left = max(power - explained, 0.0) / 2.0 / max(1.0 - 0.5 * p / independent, 0.1)
        noise = math.sqrt(left)
        links = math.sqrt(max(explained, 0.0))
        limit = math.sqrt(max(left, self._noise**2) * self._quantile / independent + self._floor**2)
        zeta = self._ratio / weight
        leak = (noise**2 / (self._size**2)).sum() / float(self._expected.mean())
        usual = 1.0 + 5.0 * math.sqrt(self._spread / independent) + leak
        scores = {"sensory": zeta / usual, "links": links / limit}
        fired = tuple(name for name, score in scores.items() if score > 1.0)
        self._state = State(
            self._samples, bool(fired), max(scores.values()), zeta, links, noise, fired
        )


class _Search:
    """The nearest node of a map: by cells where they know, by the search tree elsewhere."""

    def __init__(self, network: Map) -> None:
        self._cells, self._tree = NodeCells.of(network), network.tree

    def nearest(self, v: Array) -> tuple[float, int]:
        """Distance and number of the node that is nearest to a point (d,) of the unit box."""
        found = None if self._cells is None else self._cells.nearest(v.tolist())
        if found is not None:
            return found
        distance, node = self._tree.query(v)
        return float(distance), int(node)


def _directions(model: Model) -> Array:
    """Displacements at each motor node by what may change, orthonormal, (nodes, 2, p)."""
    body = seen_body(model) if model.body is None else model.body
    every = np.unique(np.concatenate(list(groups_of(body).values())))
    q = model.motor.scale.from_unit(np.clip(model.motor.units, 0.0, 1.0))
    _, x = body.structure.linearise(q, body.beta, every)
    n, m, k = x.shape
    flat = x.reshape(n * m, k)
    flat = flat / (np.linalg.norm(flat, axis=0) + 1e-300)
    left, size, _ = np.linalg.svd(flat, full_matrices=False)
    kept = left[:, size > _COLLINEAR * size[0]][:, :_DIRECTIONS]
    return np.ascontiguousarray(kept.reshape(n, m, -1) * np.sqrt(n))


def _own_error(model: Model) -> float:
    """Root mean square error [unit] that the model may have of itself."""
    bound = np.nan_to_num(model.model_bounds[model.visited])
    extent = float(np.linalg.norm(model.sensory.scale.span))
    return max(0.5 * float(np.sqrt(np.mean(bound**2))), _GRAIN * extent)


def _second_order(model: Model) -> tuple[Array, Array, Array]:
    """Value, slope and half the curvature of the map at each motor node."""
    predictor = model.predictor
    value, slope = predictor.value_and_slope(model.motor.units)
    step = 0.25 * model.motor.spacing
    bend = np.empty((*slope.shape, slope.shape[-1]))
    for k in range(slope.shape[-1]):
        ahead, back = model.motor.units.copy(), model.motor.units.copy()
        ahead[:, k] += step
        back[:, k] -= step
        change = predictor.value_and_slope(ahead)[1] - predictor.value_and_slope(back)[1]
        bend[..., k] = 0.5 * change / (2.0 * step)
    return value, slope, bend


def _chi_square(freedom: int) -> float:
    """What a chi-square variable exceeds next to never."""
    from scipy.special import chdtri

    return float(chdtri(freedom, FALSE_ALARM))
