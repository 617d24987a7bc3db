"""The monitor: one sample at a time, in constant memory, whether the map still fits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import mul
from typing import Any, NamedTuple

import numpy as np

from ..common.arrays import Array
from ..errors import ModelError, QueryError
from ..maps.map import Map
from ..model.model import Model
from .group_tests import groups_of
from .seen import body_of

_WINDOW = 200.0  # samples that the monitor remembers: older ones fade by a factor of e
_FALSE_ALARM = 1e-6  # share of the samples of a calm stream that raise an alarm, nominally
_COLLINEAR = 1e-3  # directions that are so much weaker than the strongest are left out
_DIRECTIONS = 8  # strongest displacements that are watched: a few microseconds each
_GRAIN = 1e-6  # share of the extent below which nothing counts as drift
_WARM = 20  # samples before the first judgement
_MOST, _DOUBTED = 100.0, 4.0  # largest ratio of distortions, of a sample that is clipped
_CLIP = 8.0  # a residual counts for at most so many standard deviations of the recent ones


class State(NamedTuple):
    """What is known after a sample."""

    samples: int  # samples seen, without those outside of what the model has learned
    drifted: bool  # whether a signal is above its threshold now
    score: float  # largest value over threshold; 0 while there are too few samples
    # distortion of the sensory map (eq. 9) over what is expected where the samples lie.
    zeta: float
    links: float  # [unit], root mean square of the systematic part of the recent residuals
    noise: float  # [unit], standard deviation per axis of the rest
    fired: tuple[str, ...]  # "sensory", "links", or both


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
    >>> monitor = calib.monitor(model)
    >>> calm = calib.babble(arm, 50, seed=1, noise=1e-3)
    >>> for q, x in zip(calm.q, calm.x):
    ...     state = monitor.update(q, x)
    >>> state.drifted
    False
    """

    def __init__(self, model: Model, window: float = _WINDOW) -> None:
        from scipy.linalg.lapack import dposv
        from scipy.special import chdtri

        self._solve = dposv
        baseline = model.baseline
        if baseline is None:
            raise ModelError("the model has no baseline of its distortions: train it again")
        motor, sensory = model.motor, model.sensory
        scale = motor.scale
        self._lower, self._span = scale.lower.tolist(), scale.span.tolist()
        self._turning = np.flatnonzero(scale.periodic).tolist()
        self._origin, self._size = sensory.scale.lower.tolist(), sensory.scale.span.tolist()
        self._next_joints, self._next_position = _search(motor), _search(sensory)
        self._expected = baseline.sensory
        self._reach = 3.0 * motor.spacing
        self._visited = model.visited
        directions = _directions(model)
        n, axes, p = directions.shape
        # a column more, for the residual: one product sums all that is remembered
        self._rows = np.concatenate([directions, np.zeros((n, axes, 1))], axis=2)
        self._nodes = np.hstack(
            [motor.units, _second_order(model), (directions**2).sum(axis=(1, 2))[:, None]]
        )
        self._fade = 1.0 - 1.0 / window
        self._moments = np.zeros((p + 1, p + 1))
        self._ridge = 1e-9 / p * np.eye(p)
        self._trace = self._weight = self._square = 0.0
        self._ratio = self._usual = 0.0
        self._floor = _own_error(model)
        self._spread = baseline.spread[1]
        self._noise = max(baseline.noise, self._floor)
        self._leak = float((sensory.scale.span**-2.0).sum() / baseline.sensory.mean())
        self._quantile = float(chdtri(p, _FALSE_ALARM))
        self._samples = 0
        self._state = State(0, False, 0.0, 0.0, 0.0, 0.0, ())

    def update(self, q: Sequence[float] | Array, x: Sequence[float] | Array) -> State:
        """Take one sample, joints (dof,) [rad or m] and position (2,) or (3,) [unit].

        A sample that is not finite or outside of what the model has learned changes nothing.
        """
        u = _unit(q, self._lower, self._span, "joint values")
        v = _unit(x, self._origin, self._size, "coordinates")
        for k in self._turning:
            u[k] %= 1.0
        if not math.isfinite(sum(u) + sum(v)):
            return self._state
        distance, node = self._next_joints(u)
        if distance > self._reach or not self._visited[node]:
            return self._state
        known = self._nodes[node].tolist()
        z = [a - b for a, b in zip(u, known, strict=False)]
        for k in self._turning:
            z[k] -= round(z[k])
        terms = [1.0, *z, *(a * b for k, a in enumerate(z) for b in z[k:])]
        row = self._rows[node].copy()
        power, place = 0.0, len(u)
        for k, value in enumerate(v):
            predicted = sum(map(mul, known[place : place + len(terms)], terms))
            residual = self._origin[k] + value * self._size[k] - predicted
            row[k, -1] = residual
            power += residual * residual
            place += len(terms)
        size = math.sqrt(power)
        usual = self._usual or self._noise
        self._usual = usual + 0.05 * (min(size, 3.0 * usual) - usual)
        limit, most = _CLIP * max(usual, self._noise), _MOST
        if size > limit:
            row[:, -1] *= limit / size
            most = _DOUBTED
        away, winner = self._next_position(v)
        fade = self._fade  # means over a window that forgets, in constant memory
        self._moments *= fade
        self._moments += row.T @ row
        self._trace = fade * self._trace + known[-1]
        self._weight = fade * self._weight + 1.0
        self._square = fade * fade * self._square + 1.0
        ratio = min(away * away / float(self._expected[winner]), most)
        self._ratio = fade * self._ratio + ratio
        self._samples += 1
        if self._samples >= _WARM:
            self._judge()
        else:
            self._state = self._state._replace(samples=self._samples)
        return self._state

    @property
    def state(self) -> State:
        """The state after the last sample."""
        return self._state

    def _judge(self) -> None:
        moments, weight, axes = self._moments, self._weight, len(self._size)
        p = len(moments) - 1
        products = moments[-1, :-1]
        gram = moments[:-1, :-1] + self._trace * self._ridge
        # LAPACK itself: NumPy's checks take longer than a system of eight equations
        _, combined, _ = self._solve(gram, products)
        explained = float(products @ combined) / weight
        power = float(moments[-1, -1]) / weight
        independent = weight * weight / self._square
        left = max(power - explained, 0.0) / axes / max(1.0 - p / (axes * independent), 0.1)
        noise, links = math.sqrt(left), math.sqrt(max(explained, 0.0))
        limit = math.sqrt(max(left, self._noise**2) * self._quantile / independent + self._floor**2)
        zeta = self._ratio / weight
        usual = 1.0 + 5.0 * math.sqrt(self._spread / independent) + left * self._leak
        sensory, moved = zeta / usual, links / limit
        fired = (*(("sensory",) if sensory > 1.0 else ()), *(("links",) if moved > 1.0 else ()))
        self._state = State(
            self._samples, bool(fired), max(sensory, moved), zeta, links, noise, fired
        )


def monitor(model: Model) -> Monitor:
    """A monitor for a stream of samples: ``monitor.update(q, x)`` after each."""
    return Monitor(model)


def _search(network: Map) -> Callable[[Sequence[float]], tuple[float, int]]:
    """What tells the distance and the number of the node next to a point (d,) of the unit box."""
    tree = network.tree

    def nearest(v: Sequence[float]) -> tuple[float, int]:
        distance, node = tree.query(v)
        return float(distance), int(node)

    return nearest


def _unit(values: Any, lower: list[float], span: list[float], what: str) -> list[float]:
    """Values in the unit box, as floats."""
    row = np.asarray(values, dtype=float).ravel().tolist()
    if len(row) != len(lower):
        raise QueryError(f"{len(row)} {what}: expected {len(lower)}")
    return [(a - low) / size for a, low, size in zip(row, lower, span, strict=True)]


def _directions(model: Model) -> Array:
    """Displacements at each motor node by what may change, orthonormal, (nodes, 2, p)."""
    body = body_of(model)
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


def _second_order(model: Model) -> Array:
    """Value, slope and curvature at each motor node, axis by axis, (nodes, terms).

    The terms of Taylor's series: those of the symmetric curvature once, of two joints both.
    """
    predictor, units = model.predictor, model.motor.units
    value, slope = predictor.value_and_slope(units)
    step = 0.25 * model.motor.spacing * np.eye(units.shape[1])
    bend = [
        predictor.value_and_slope(units + s)[1] - predictor.value_and_slope(units - s)[1]
        for s in step
    ]
    curvature = np.stack(bend, axis=-1) / (4.0 * step[0, 0])
    curvature += np.swapaxes(curvature, 2, 3) * (1.0 - np.eye(len(step)))
    first, second = np.triu_indices(len(step))
    terms = [value[:, :, None], slope, curvature[:, :, first, second]]
    return np.asarray(np.concatenate(terms, axis=2).reshape(len(value), -1))
