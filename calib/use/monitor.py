"""The monitor: tests with each sample, in constant memory, whether the model still fits."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.information import lengths_of, matern
from ..change.causes import single_causes, with_chain_in_doubt
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
from ..common.rows import row_lengths, spread_rows
from ..errors import ModelError, QueryError
from ..model.model import Model


@dataclass(frozen=True)
class MonitorSettings:
    """How a stream is watched."""

    # samples over which the weight of older ones fades by a factor of e
    window: float = 200.0
    every: int = 10  # samples between two judgements
    ahead: int = 2  # samples after one that show whether it is an outlier
    nodes: int = 20  # of the model's own residual
    # largest autocorrelation from sample to sample that is counted
    most_alike: float = 0.99
    # share of calm samples that may be alarms
    false_alarm: float = 1e-6
    # largest residual that counts, over the usual one
    clip: float = 8.0
    # correlation of the model's errors from which poses are near each other
    near: float = 0.99
    # factor on the standard error of the readings' variance
    no_chance: float = 4.0
    # least variance of readings, over that of the noise: a sensor that rounds shows none
    least_readings: float = 1e-4
    # prior sd of the delay of positions after joints [samples]
    late: float = 1.0
    # part of the effect of a late clock that remains once it is corrected, over that effect: the
    # model's error at the earlier pose is another one
    late_leaves: float = 0.1

    @property
    def fade(self) -> float:
        """Weight of a sample over that of the next."""
        return 1.0 - 1.0 / self.window


MONITOR = MonitorSettings()


class State(NamedTuple):
    """The state of a monitor after a sample."""

    samples: int  # without those outside of what the model has learned
    drifted: bool  # whether a signal is above its threshold now
    score: float  # largest of a test; 0 while there are too few samples
    # [unit], standard deviation per axis of what no change explains; NaN before it is known
    noise: float
    # the most significant group of parameters, where one fired
    fired: tuple[str, ...]
    # [samples], by which positions come later than joints: no change of the arm
    delay: float = 0.0


class Monitor:
    """Watches a stream of samples: the sequential form of the tests of `check`.

    It keeps products of the recent residuals with the columns of all parameters that may have
    changed and of those that the model does not know: the system of `calib.judge`, whose rows fade.

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
        # joints and residuals since the last judgement
        self._latest: list[tuple[Array, Array]] = []
        self.state = State(0, False, 0.0, np.nan, ())
        """After the last sample."""

    def update(
        self, q: Sequence[float] | Array, x: Sequence[float] | Array
    ) -> State:
        """Take one sample, joints (dof,) [rad or m] and position (2,) or (3,) [unit].

        A sample that is not finite or outside of what the model has learned changes nothing.
        Orientations are not watched: a tool that turned about its tip is no alarm.
        """
        model = self._model
        q = np.asarray(q, float)
        x = np.asarray(x, float)
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
        state = self.state._replace(samples=self.state.samples + 1)
        if state.samples % MONITOR.every == 0:
            state = self._judge(state)
        self.state = state
        return state

    def _judge(self, state: State) -> State:
        """The state by the tests of the samples that are remembered."""
        equations = self._equations
        q, residual = map(np.array, zip(*self._latest, strict=True))
        self._latest = self._latest[-MONITOR.ahead :]
        equations.add(q, residual)
        test = equations.most_telling()
        score = (
            test.score * math.log(FALSE_ALARM) / math.log(MONITOR.false_alarm)
        )
        drifted = score > 1.0
        return state._replace(
            drifted=drifted,
            score=score,
            noise=equations.noise,
            fired=(test.name,) if drifted else (),
            delay=equations.delay,
        )


class _SampleWeights:
    """Weight of each sample: 1 at a new pose, and less near recent ones.

    Of the noise variance a share c is the model's own error, which is equal at near poses; 1 - c is
    the sensor's.  Readings determine a share s of the model's error at a pose, and a further one
    there adds little: its weight is the gain in s over 1 - c.
    """

    def __init__(self, body: Body, nodes: Array) -> None:
        self._lengths = lengths_of(body, nodes)
        # mean squares of the steps between the latest readings at near poses, over twice the
        # noise variance
        self._squared_steps: deque[float] = deque(maxlen=round(MONITOR.window))
        self._fixed_share = 0.0  # s at the pose of the last sample
        # joints and residual of the last sample
        self._last: tuple[Array, Array] | None = None

    def of(self, q: Array, rest: Array) -> Array:
        """Weights (b,) of samples at joints (b, dof).

        rest : (b, m), residuals over the usual noise, without the effect of a late clock
        """
        last_q, last_rest = self._last or (q[0], rest[0])
        self._last = (q[-1], rest[-1])
        before = np.vstack([last_q, q[:-1]])
        alike = matern(q, before, self._lengths).diagonal()
        squares = (_steps(rest, last_rest) ** 2).mean(axis=1) / 2.0
        self._squared_steps.extend(squares[alike > MONITOR.near].tolist())

        readings = self.variance_of_readings(rest.shape[1])
        weights = np.ones(len(q))
        if readings >= 1.0:
            return weights
        for row, share in enumerate(alike**2):
            before_row = share * self._fixed_share
            odds = before_row / (1.0 - before_row) + (1.0 - readings) / readings
            self._fixed_share = odds / (1.0 + odds)
            gain = self._fixed_share - before_row
            weights[row] = gain / (1.0 - readings)
        return weights

    def medians(self, q: Array, y: Array) -> Array:
        """Medians (b, m) of the residuals (b, m) near each (a Hampel filter)."""
        is_near = matern(q, q, self._lengths) > MONITOR.near
        return np.array([np.median(y[near], axis=0) for near in is_near])

    def variance_of_readings(self, outputs: int) -> float:
        """Upper limit of 1 - c, the sensor's share of the noise variance; infinite at first."""
        from scipy.special import chdtri

        count = len(self._squared_steps)
        if not count:
            return math.inf
        # of squares half are below the median: wrong detections do not count
        usual = float(chdtri(outputs, 0.5)) / outputs
        share = float(np.median(self._squared_steps)) / usual
        by_chance = MONITOR.no_chance / math.sqrt(count)
        return max(share, MONITOR.least_readings) * (1.0 + by_chance)


class _Equations:
    """The system of the recent samples: columns B of unknown parameters, X of possible changes.

    Noise that drifts slowly looks like a change.  Its steps from sample to sample show it: their
    mean square is 2 s^2 (1 - a) for the usual noise s and an autocorrelation a.  With the products
    G of rows and S of their steps, the products of whitened rows are

        W = ((1 - a)^2 G + a S) / (1 - a^2)
    """

    def __init__(self, model: Model, body: Body) -> None:
        self.noise = float(body.noise[0])  # [unit]
        self.delay = 0.0  # [samples]
        self._reference = Reference(with_chain_in_doubt(body), body.beta)
        structure = body.structure
        units = model.motor.units_in_box
        nodes = model.motor.scale.from_unit(units)
        # X: all parameters that may change, and the groups that are tested
        causes = single_causes(structure)
        self._changes = np.unique(np.concatenate([*causes.values()]))
        self._groups = {
            name: np.searchsorted(self._changes, indices)
            for name, indices in groups_of(structure, causes).items()
            if np.isin(indices, self._changes).all()
        }
        self._moves = moves_of(structure, body.beta, nodes)[self._changes]
        self._sd = sd_of_changes(self._reference)[self._changes]
        # B: a late clock, the posterior of the parameters, and a smooth residual about some nodes
        self._posterior, self._root = prior_columns(
            self._reference, creep_share=CREEP_SHARE
        )
        self._nodes = nodes[spread_rows(len(nodes), MONITOR.nodes)]
        outputs = structure.outputs
        self._nuisances = 1 + outputs * len(self._nodes) + self._root.shape[1]

        size = self._nuisances + len(self._changes) + 1
        self._sample_weights = _SampleWeights(body, nodes)
        # of the latest samples the delay by each, and how much a late clock moves it
        self._delays: deque[tuple[float, float]] = deque(
            maxlen=round(MONITOR.window)
        )
        # fading sums of the samples' weights and of their squares
        self._weight = 0.0
        self._squares = 0.0
        # fading products of the columns B (r), X (k) and the residuals: G, and S of their steps
        self._products = np.zeros((size, size))
        self._steps = np.zeros((size, size))
        self._alike = 0.0  # a
        # of the last sample: where it was predicted, and its row (m, r + k + 1)
        self._last_predicted: Array | None = None
        self._last_row: Array | None = None

    def add(self, q: Array, residual: Array) -> None:
        """Take residuals (b, m) [unit] of samples at joints (b, dof); the last ones come again."""
        count = len(q) - MONITOR.ahead
        sizes = self._reference.expected_noise
        columns = self._columns(q) / sizes[:, None]
        y = residual / sizes
        medians = self._sample_weights.medians(q, y)
        medians = medians[:count]
        columns = columns[:count]
        y = y[:count]
        q = q[:count]

        # where the arm stops often, a late clock causes outliers at each motion
        late = columns[:, :, 0]
        delay = self._delay_of(y, late)
        outputs = y.shape[1]
        variance = outputs * self._sample_weights.variance_of_readings(outputs)
        most = MONITOR.clip * math.sqrt(variance)
        is_outlier = row_lengths(y - medians) > most
        left_over = row_lengths(y - delay * late - medians)
        by_late = MONITOR.late_leaves * row_lengths(delay * late)
        late[is_outlier & (left_over > np.maximum(most, by_late))] = 0.0
        rest = np.where(is_outlier[:, None], medians, y - delay * late)
        rest = self._clipped(rest)
        y = rest + delay * late
        rows = np.concatenate([columns, y[:, :, None]], axis=2)
        steps = _steps(rows, self._last_row)
        self._last_row = rows[-1]
        weights = self._sample_weights.of(q, rest)
        if not self._weight:
            weights[0] = 0.0  # no step leads to the first sample
        older = MONITOR.fade ** weights.sum()
        age = weights[::-1].cumsum()[::-1] - weights
        weights *= MONITOR.fade**age
        self._weight = older * self._weight + weights.sum()
        self._squares = older**2 * self._squares + (weights**2).sum()
        self._products = older * self._products + _products(rows, weights)
        self._steps = older * self._steps + _products(steps, weights)

    def _columns(self, q: Array) -> Array:
        """Columns (b, m, r + k) at joints (b, dof) [unit], the first by a late clock."""
        body = self._reference.body
        predicted, slope = body.structure.linearise(q, self._reference.beta)
        late = -_steps(predicted, self._last_predicted)
        self._last_predicted = predicted[-1 - MONITOR.ahead]
        residual_sd = body.kappa * self._reference.residual_sd
        columns = [
            MONITOR.late * late[:, :, None],
            smooth_columns(body, residual_sd, q, self._nodes),
            slope[:, :, self._posterior] @ self._root,
            slope[:, :, self._changes],
        ]
        return np.concatenate(columns, axis=2)

    def _delay_of(self, y: Array, late: Array) -> float:
        """Delay by the latest samples, residuals (b, m) over what a late clock does (b, m).

        Of least absolute deviations: samples at rest hardly change it, nor does a wrong detection.
        """
        size = row_lengths(late)
        size = np.maximum(size, 1e-150)
        ratio = (y * late).sum(axis=1) / size**2
        self._delays.extend(zip(ratio.tolist(), size.tolist(), strict=True))
        # where nothing moves the delay is 0
        none = (0.0, MONITOR.clip)
        ratios, sizes = np.array(sorted([*self._delays, none])).T
        share = np.cumsum(sizes) / sizes.sum()
        return float(ratios[np.searchsorted(share, 0.5)])

    def _clipped(self, rest: Array) -> Array:
        """Residuals (b, m), over the noise, none of which is many times as long as usual."""
        lengths = row_lengths(rest)
        usual = max(float(np.median(lengths)), math.sqrt(rest.shape[1]))
        excess = np.maximum(lengths / (MONITOR.clip * usual), 1.0)
        return np.asarray(rest / excess[:, None])

    def most_telling(self) -> GroupTest:
        """The most significant of the tests of all groups."""
        weight = self._weight
        independent = weight**2 / self._squares
        alike = self._alike
        gram = (1.0 - alike) ** 2 * self._products + alike * self._steps
        gram *= independent / weight / (1.0 - alike**2)
        count = independent * self._reference.structure.outputs
        # the noise and the solution where everything may have changed
        sd = np.concatenate([np.ones(self._nuisances), self._sd, [1.0]])
        freed = gram * sd * sd[:, None]
        every = Statistics.of_gram(count, freed, len(gram) - 1)
        usual = usual_noise(self._reference)
        size = every.most_likely_noise(usual)
        precision = freed[:-1, :-1] + size**2 * np.eye(len(gram) - 1)
        solution = sd[:-1] * np.linalg.solve(precision, freed[:-1, -1])
        freedom = every.noise_freedom(size)
        self.noise = float(self._reference.expected_noise[0]) * size
        self.delay = MONITOR.late * float(solution[0])
        # autocorrelation of the remaining residual from sample to sample
        rest = np.append(-solution, 1.0)
        square = rest @ self._steps @ rest * independent / weight
        usual_square = 2.0 * max(freedom, 1.0) * usual**2
        alike = 1.0 - float(square) / usual_square
        self._alike = min(max(alike, 0.0), MONITOR.most_alike)
        # each group against that noise
        products = Statistics.of_gram(count, gram, self._nuisances)
        tests = FTests(products, size, freedom, 1.0, len(self._groups))
        groups = tests.of_groups(self._groups, self._moves)
        penalty = math.log(max(freedom, 1.0))
        # where probabilities are too small for a number, the likelier change
        return max(
            groups, key=lambda t: (t.score, t.statistic - penalty * t.freedom)
        )


def _steps(values: Array, last: Array | None) -> Array:
    """Steps (b, ..) of values (b, ..) from one to the next, the first from that before them."""
    if last is None:
        last = values[0]
    return np.diff(values, axis=0, prepend=last[None])


def _products(rows: Array, weights: Array) -> Array:
    """Products (c, c) of the columns of rows (b, m, c) of weights (b,)."""
    flat = (np.sqrt(weights)[:, None, None] * rows).reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)


def monitor(model: Model) -> Monitor:
    """A monitor for a stream of samples: ``monitor.update(q, x)`` after each."""
    return Monitor(model)
