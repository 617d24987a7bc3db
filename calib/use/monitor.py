"""The monitor: one sample at a time, in constant memory, whether the model still fits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..body.belief import Body
from ..change.causes import CREEP_WAVES, single_causes
from ..change.frame import Reference
from ..change.noise import FALSE_ALARM, sd_of_changes, usual_noise
from ..change.significance import (
    FTests,
    GroupTest,
    groups_of,
    moves_of,
)
from ..change.system import (
    CREEP_SHARE,
    Statistics,
    prior_columns,
    smooth_columns,
)
from ..common.arrays import Array
from ..common.rows import spread_rows
from ..errors import ModelError, QueryError
from ..model.model import Model


@dataclass(frozen=True)
class MonitorSettings:
    """How a stream is watched."""

    # samples that are remembered: older ones fade by a factor of e
    window: float = 200.0
    # samples between two judgements
    every: int = 10
    # nodes of the model's own residual
    nodes: int = 20
    # standard errors from which an autocorrelation is none of chance
    chance: float = 3.0
    # largest autocorrelation from sample to sample that is counted
    most_alike: float = 0.99
    # share of calm samples that may be alarms
    false_alarm: float = 1e-6
    # times the usual residual that one counts for at most
    clip: float = 8.0

    @property
    def fade(self) -> float:
        """Weight of a sample over that of the next."""
        return 1.0 - 1.0 / self.window


MONITOR = MonitorSettings()


class State(NamedTuple):
    """What is known after a sample."""

    # samples seen, without those outside of what the model has learned
    samples: int
    drifted: bool  # whether a signal is above its threshold now
    # largest score of a test; 0 while there are too few samples
    score: float
    # [unit], standard deviation per axis of what no change explains; NaN before it is known
    noise: float
    # the most telling group of parameters, where one fired
    fired: tuple[str, ...]


class Monitor:
    """Watches a stream of samples: the sequential form of the tests of `check`.

    Of the recent past it keeps the products of the residual with the columns of all that may have
    changed and of what the model does not know: the system of `calib.judge`, whose rows fade.

    Parameters
    ----------
    model : Model
        The map to watch.

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

    def __init__(self, model: Model) -> None:
        if model.body is None:
            raise ModelError(
                "maps alone have no parameters that could change",
                hint="judge their rows with `check`, or train with `body='auto'`",
            )
        self._model = model
        self._equations = _Equations(model, model.body)
        # sums that fade: samples, squared weights
        self._sums = np.zeros(2)
        # joints and residuals since the last judgement
        self._latest: list[tuple[Array, Array]] = []
        self.state = State(0, False, 0.0, np.nan, ())
        """After the last sample."""

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
            return self.state
        residual = x - model.forward(q)
        if not np.isfinite(residual).all():
            return self.state
        self._latest.append((q, residual))
        fade = MONITOR.fade
        self._sums = self._sums * [fade, fade**2] + 1.0
        state = self.state._replace(samples=self.state.samples + 1)
        if state.samples % MONITOR.every == 0:
            state = self._judge(state)
        self.state = state
        return state

    def _judge(self, state: State) -> State:
        """The state by the tests of the samples that are remembered."""
        weight, squares = self._sums.tolist()
        equations = self._equations
        q, residual = map(np.array, zip(*self._latest, strict=True))
        self._latest = []
        equations.add(q, residual)
        test = equations.most_telling(weight, weight**2 / squares)
        score = (
            test.score * math.log(FALSE_ALARM) / math.log(MONITOR.false_alarm)
        )
        drifted = score > 1.0
        return state._replace(
            drifted=drifted,
            score=score,
            noise=equations.noise,
            fired=(test.name,) if drifted else (),
        )


class _Equations:
    """The system of the samples that are remembered: B, what is not known, and X, what may change.

    gram : (r + k + 1)^2, fading products of the columns B (r), X (k) and of the residuals
    solution : (r + k,), what explains the samples
    """

    def __init__(self, model: Model, body: Body) -> None:
        self.noise = float(body.noise[0])  # [unit]
        self._reference = Reference(body, body.beta)
        structure = body.structure
        units = np.clip(model.motor.units, 0.0, 1.0)
        nodes = model.motor.scale.from_unit(units)
        # X: all parameters that may change, and the groups that are tested
        causes = single_causes(structure).values()
        self._changes = np.unique(np.concatenate([*causes]))
        self._groups = {
            name: np.searchsorted(self._changes, indices)
            for name, indices in groups_of(structure).items()
            if np.isin(indices, self._changes).all()
        }
        self._moves = moves_of(structure, body.beta, nodes)[self._changes]
        self._sd = sd_of_changes(self._reference)[self._changes]
        # B: the posterior of the parameters, and a smooth residual about some nodes
        self._posterior, self._root = prior_columns(
            self._reference, CREEP_WAVES, CREEP_SHARE
        )
        self._nodes = nodes[spread_rows(len(nodes), MONITOR.nodes)]
        outputs = structure.outputs
        self._nuisances = outputs * len(self._nodes) + self._root.shape[1]

        size = self._nuisances + len(self._changes)
        self._gram = np.zeros((size + 1, size + 1))
        self._solution = np.zeros(size)
        # what the solution left of the last sample; fading sums of its products with the next, and
        # of its squares
        self._last_rest = np.zeros(outputs)
        self._lagged = np.zeros(2)

    def add(self, q: Array, residual: Array) -> None:
        """Take residuals (b, m) [unit] of samples at joints (b, dof)."""
        columns = self._columns(q)
        y = self._clipped(residual / self._reference.sizes)
        weights = MONITOR.fade ** np.arange(len(q))[::-1]
        forgetting = MONITOR.fade ** len(q)
        # how alike the noise of a sample is to that of the next
        rest = y - columns @ self._solution
        before = np.concatenate([self._last_rest[None], rest[:-1]])
        products = (rest * before).sum(axis=1)
        squares = (rest**2).sum(axis=1)
        lagged = np.array([products, squares]) @ weights
        self._lagged = forgetting * self._lagged + lagged
        self._last_rest = rest[-1]

        rows = np.concatenate([columns, y[:, :, None]], axis=2)
        rows *= np.sqrt(weights)[:, None, None]
        flat = rows.reshape(-1, rows.shape[2])
        self._gram = forgetting * self._gram + flat.T @ flat

    def _columns(self, q: Array) -> Array:
        """Columns (b, m, r + k) at joints (b, dof), over the noise."""
        body = self._reference.body
        _, slope = body.structure.linearise(q, self._reference.beta)
        residual_sd = body.kappa * self._reference.residual_sd
        columns = [
            smooth_columns(body, residual_sd, q, self._nodes),
            slope[:, :, self._posterior] @ self._root,
            slope[:, :, self._changes],
        ]
        sizes = self._reference.sizes
        return np.asarray(np.concatenate(columns, axis=2) / sizes[:, None])

    def _clipped(self, y: Array) -> Array:
        """Residuals (b, m), over the noise, none of which is many times as long as usual."""
        most = MONITOR.clip * max(self.noise / self._reference.sizes[0], 1.0)
        length = np.linalg.norm(y, axis=1) / math.sqrt(y.shape[1])
        return np.asarray(y / np.maximum(length / most, 1.0)[:, None])

    def most_telling(self, weight: float, independent: float) -> GroupTest:
        """The most telling of the tests of all groups.

        weight : of the samples, which fade; independent : how many as telling ones
        """
        gram = self._gram * independent / weight
        count = independent * self._reference.structure.outputs
        # the noise and the solution where everything may have changed
        sd = np.concatenate([np.ones(self._nuisances), self._sd, [1.0]])
        freed = gram * sd * sd[:, None]
        every = Statistics.of_gram(count, freed, len(gram) - 1)
        size = every.most_likely_noise(usual_noise(self._reference))
        precision = freed[:-1, :-1] + size**2 * np.eye(len(gram) - 1)
        self._solution = sd[:-1] * np.linalg.solve(precision, freed[:-1, -1])
        self.noise = float(self._reference.sizes[0]) * size
        # each group beside that noise
        temper = self._correlation_time(independent)
        products = Statistics.of_gram(count, gram, self._nuisances)
        freedom = every.noise_freedom(size) / temper
        tests = FTests(products, size, freedom, temper, len(self._groups))
        groups = tests.of_groups(self._groups, self._moves)
        penalty = math.log(max(freedom, 1.0))
        # of chances too small for a number the more likely change
        return max(
            groups, key=lambda t: (t.score, t.statistic - penalty * t.freedom)
        )

    def _correlation_time(self, independent: float) -> float:
        """Samples that count for one, where noise is alike from each to the next."""
        product, square = self._lagged.tolist()
        alike = product / max(square, 1e-300)
        numbers = independent * self._reference.structure.outputs
        if alike < MONITOR.chance / math.sqrt(numbers):
            return 1.0
        alike = min(alike, MONITOR.most_alike)
        return (1.0 + alike) / (1.0 - alike)


def monitor(model: Model) -> Monitor:
    """A monitor for a stream of samples: ``monitor.update(q, x)`` after each."""
    return Monitor(model)
