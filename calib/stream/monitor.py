"""The monitor: one sample at a time, in constant memory, whether the model still fits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.settings import SIMULATED_FLOOR
from ..common.arrays import Array
from ..errors import ModelError, QueryError
from ..model.model import Model

_WATCHED = (
    *("view.rotation", "view.shift", "view.scale", "view.tilt", "view.shear"),
    *("offset", "length", "gain", "placement", "tool", "elastic", "payload"),
)
"""Groups whose displacements are looked for; of a lens its first term."""


@dataclass(frozen=True)
class MonitorSettings:
    """How a stream is watched."""

    # samples before the first judgement
    warm: int = 20
    # strongest displacements; further ones are nearly sums of these
    directions: int = 8
    # directions that are so much weaker than the strongest are left out
    collinear: float = 1e-3
    # standard errors from which an autocorrelation is none of chance
    chance: float = 3.0
    # autocorrelation from sample to sample that is counted at most
    most_alike: float = 0.99
    # share of calm samples that may be alarms
    false_alarm: float = 1e-6
    # Times its own bound of 95 % that a model may be off for a while, as where an arm dwells
    nuisance: float = 1.5
    # a residual counts for at most so many times the usual one
    clip: float = 8.0


MONITOR = MonitorSettings()


class State(NamedTuple):
    """What is known after a sample."""

    # samples seen, without those outside of what the model has learned
    samples: int
    drifted: bool  # whether a signal is above its threshold now
    # largest value over threshold; 0 while there are too few samples
    score: float
    zeta: float  # distortion of the sensory map (eq. 9) over what is expected there
    # [unit], root mean square of the systematic part of the recent residuals
    links: float
    noise: float  # [unit], standard deviation per axis of the rest
    fired: tuple[str, ...]  # ``("links",)`` where the residuals are systematic


class Monitor:
    """Watches a stream of samples: a sequential form of the tests of `check`.

    Of the recent past it keeps the products of the residual with the displacements that a change
    would make.  What these explain is compared with chance, and with what the model may be off by
    itself where the samples lie.

    Parameters
    ----------
    model : Model
        The map to watch.
    window : float
        Samples that are remembered: older ones fade by a factor of e.

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

    def __init__(self, model: Model, window: float = 200.0) -> None:
        from scipy.special import fdtri

        if model.baseline is None:
            raise ModelError(
                "the model has no baseline of its distortions: train it again"
            )
        self._model = model
        self._expected = model.baseline.sensory
        if model.body is not None:
            groups = model.body.structure.groups
            watched = [groups[name] for name in _WATCHED if name in groups]
            lens = groups.get("lens", np.zeros(0, np.intp))[:1]
            self._every = np.unique(np.concatenate([*watched, lens])).astype(
                np.intp
            )
        self._combined = _orthonormal(
            self._moves(np.clip(model.motor.units, 0.0, 1.0))
        )
        axes = model.sensory.scale.span.size
        p = self._combined.shape[1]
        self._fade = 1.0 - 1.0 / window
        self._own = _own_error(model)
        self._noise = model.baseline.noise
        self._least = SIMULATED_FLOOR * float(
            np.linalg.norm(model.sensory.scale.span)
        )
        # by numbers of independent samples: what chance explains of noise, in its variances
        free = np.maximum(axes * np.arange(int(2.0 * window) + 2.0) - p, 1.0)
        self._chance = p * np.asarray(fdtri(p, free, 1.0 - MONITOR.false_alarm))
        # sums that fade: products; samples, squared weights, zeta over the usual, squared bounds
        self._moments = np.zeros((p + 1, p + 1))
        self._sums = np.zeros(4)
        self._state = State(0, False, 0.0, 0.0, 0.0, 0.0, ())
        self._change = np.zeros(
            p
        )  # what explains the sums, by the combined directions
        # what it left of the last sample; sums that fade of its products with the next, and squares
        self._rest = np.zeros(axes)
        self._lagged = np.zeros(2)

    def update(
        self, q: Sequence[float] | Array, x: Sequence[float] | Array
    ) -> State:
        """Take one sample, joints (dof,) [rad or m] and position (2,) or (3,) [unit].

        A sample that is not finite or outside of what the model has learned changes nothing.
        """
        model = self._model
        q = np.asarray(q, dtype=float)
        x = np.asarray(x, dtype=float)
        expected = len(model.about.joint_names), len(model.axes)
        if (*q.shape, *x.shape) != expected:
            raise QueryError(
                f"{q.size} joint values and {x.size} coordinates: expected "
                f"{expected[0]} and {expected[1]}"
            )
        if not np.isfinite([*q, *x]).all():
            return self._state
        residual = x - model.forward(q)
        if not np.isfinite(residual).all():
            return self._state
        unit = model.motor.scale.to_unit(q[None])
        bound = float(self._own[model.motor.nearest(unit)[1][0, 0]])
        usual = math.sqrt(self._moments[-1, -1] / max(self._sums[0], 1.0))
        size = max(float(np.linalg.norm(residual)), 1e-300)
        most = MONITOR.clip * max(usual, self._noise, bound)
        residual *= min(1.0, most / size)
        moves = self._moves(unit)[0] @ self._combined
        row = np.column_stack([moves, residual])
        rest = residual - moves @ self._change
        fade = self._fade  # sums over a window that forgets
        self._lagged = fade * self._lagged + [rest @ self._rest, rest @ rest]
        self._rest = rest
        places = model.sensory.scale.to_unit(x[None])
        away, winner = model.sensory.nearest(places)
        ratio = float(away[0, 0] ** 2 / self._expected[winner[0, 0]])
        self._moments = fade * self._moments + row.T @ row
        latest = np.array([1.0, 1.0, ratio, bound**2])
        self._sums = self._sums * [fade, fade**2, fade, fade] + latest
        self._state = self._judged(len(x))
        return self._state

    @property
    def state(self) -> State:
        """The state after the last sample."""
        return self._state

    def _judged(self, axes: int) -> State:
        """What the sums say: an F test, of as many samples as are independent of each other."""
        moments = self._moments
        p = len(self._moments) - 1
        weight, square, ratio, bound = self._sums.tolist()
        gram = moments[:-1, :-1].copy()
        products = moments[:-1, -1]
        gram[np.diag_indices(p)] += 1e-9 * np.trace(gram) / p + 1e-300
        self._change = np.linalg.solve(gram, products)
        explained = max(float(products @ self._change), 0.0) / weight
        count = self._state.samples + 1
        independent = weight**2 / square
        independent /= self._correlation_time(independent)
        independent = max(independent, 1.0)
        variance = max(float(moments[-1, -1]) / weight - explained, 0.0) / axes
        variance /= max(1.0 - p / (axes * independent), 0.1)
        chance = float(self._chance[int(independent)]) / independent
        chance *= max(variance, self._noise**2)
        nuisance = MONITOR.nuisance**2 * bound / weight + self._least**2
        score = 0.0
        if count >= MONITOR.warm:
            score = math.sqrt(explained / (chance + nuisance))
        drifted = score > 1.0
        return State(
            samples=count,
            drifted=drifted,
            score=score,
            zeta=ratio / weight,
            links=math.sqrt(explained),
            noise=math.sqrt(variance),
            fired=("links",) if drifted else (),
        )

    def _correlation_time(self, samples: float) -> float:
        """Samples that count for one, where noise is alike from each to the next."""
        product, square = self._lagged.tolist()
        alike = product / max(square, 1e-300)
        if alike < MONITOR.chance / math.sqrt(samples):
            return 1.0
        alike = min(alike, MONITOR.most_alike)
        return (1.0 + alike) / (1.0 - alike)

    def _moves(self, units: Array) -> Array:
        """Displacements (n, m, k) at joints (n, dof) in the unit box by what may change."""
        model = self._model
        body = self._model.body
        if body is None:  # a sensor that is moved
            return affine_columns(model.predictor.value(units))
        q = model.motor.scale.from_unit(units)
        return np.asarray(
            body.structure.linearise(q, body.beta, self._every)[1]
        )


def monitor(model: Model) -> Monitor:
    """A monitor for a stream of samples: ``monitor.update(q, x)`` after each."""
    return Monitor(model)


def affine_columns(x: Array, outputs: int | None = None) -> Array:
    """Displacements (n, m, (1 + p) m) of positions (n, p) by an affine map of their frame."""
    n = len(x)
    m = outputs or x.shape[1]
    bent = np.concatenate([np.ones((n, 1)), x], axis=1)
    return np.asarray(
        np.einsum("nk,ij->nikj", bent, np.eye(m)).reshape(n, m, -1)
    )


def _orthonormal(moves: Array) -> Array:
    """Combinations (k, p) of displacements (n, m, k) that are orthonormal over the rows."""
    n, m, k = moves.shape
    flat = moves.reshape(n * m, k)
    lengths = np.linalg.norm(flat, axis=0) + 1e-300
    _, size, turn = np.linalg.svd(flat / lengths, full_matrices=False)
    strong = np.flatnonzero(size > MONITOR.collinear * size[0])[
        : MONITOR.directions
    ]
    return np.asarray(
        turn[strong].T / size[strong] * np.sqrt(n) / lengths[:, None]
    )


def _own_error(model: Model) -> Array:
    """95 % bound (nodes,) [unit] of what the model is off by itself around each motor node.

    `model_error` holds the sensor's noise, too, where no pose was repeated, and hides a change.
    """
    body = model.body
    if body is None:
        bounds = model.model_bounds
        return np.where(
            np.isfinite(bounds), bounds, np.nanmax(bounds, initial=0.0)
        )
    # as of a simulation: none of the residual counts as the model's but what is told here
    belief = replace(
        body, residual=np.hypot(body.residual, body.tau), simulated=True
    )
    q = model.motor.scale.from_unit(np.clip(model.motor.units, 0.0, 1.0))
    # a play of joints or an adaptation in places is beyond the body
    beyond = np.nan_to_num(model.model_bounds) - body.bound(q, noise=False)
    return np.asarray(belief.bound(q, noise=False) + np.maximum(beyond, 0.0))
