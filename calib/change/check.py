"""Checking: whether a model still fits the arm, and which of several models does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..errors import LogError, OptionError
from ..maps.map import Map, search_tree
from ..model.model import Model
from ..samples.samples import Samples
from .causes import Cause
from .judge import judge
from .rows import LogRows
from .settings import FALSE_ALARM
from .tests import GroupTest, fired

_MOST = 1000  # rows that distortions are measured on


@dataclass(frozen=True)
class Signal:
    """One measure of how a log lies on the maps: a display, no alarm."""

    value: float  # of the log
    threshold: float  # what is usual where it lies

    @property
    def score(self) -> float:
        """Value over threshold."""
        return (
            self.value / self.threshold if self.threshold > 0 else float(self.value > 0)
        )


@dataclass(frozen=True, eq=False, repr=False)
class Drift:
    """What a log says of a model.

    Attributes
    ----------
    drifted : bool or None
        Whether something changed; None where the rows are too few to say, or too coarse for what
        was tolerated.
    samples : int
        Rows that were compared.
    outliers : int
        Rows that contradict all others; they count for next to nothing.
    score : float
        Largest score of a test: above 1 it fired.
    groups : tuple of GroupTest
        Every group that was tested.
    smallest : float [unit]
        Displacement (rms over the learned range) by the smallest change that rows could show.
    tolerance : float or None [unit]
        What the user asked for.
    distortion : dict of str to Signal
        "motor" and "sensory": zeta of the maps (eq. 9), in the unit box.  "reverse": mean squared
        distance of the nodes predicted for the joints to those that the positions visit.
        "links": root mean square of measured less predicted position [unit].
    noise, usual_noise : float [unit]
        Standard deviation per axis of what is left over, now and in training.
    causes : tuple of Cause
        What explains the data, the largest first.
    notes : tuple of str
        What else the user should be told.
    adapts : bool
        Whether `adapt` re-calibrates the model by these rows.
    left_out : int
        Rows of the log that are wrong, or outside of what the model has learned.
    bound_holds : bool
        Whether no more rows than usual are beyond the model's own 95 % bound.
    covered : float
        Share of the rows within that bound.
    too_few : bool
        Whether rows are too few to show a change of ten times the noise.
    unit : str
        Unit of the positions; "sensor" where their scale shows that it is not the model's.
    """

    drifted: bool | None
    samples: int
    outliers: int
    left_out: int
    score: float
    smallest: float
    tolerance: float | None
    adapts: bool
    groups: tuple[GroupTest, ...]
    distortion: dict[str, Signal]
    noise: float
    usual_noise: float
    causes: tuple[Cause, ...]
    notes: tuple[str, ...]
    bound_holds: bool
    covered: float
    too_few: bool
    unit: str

    def __repr__(self) -> str:
        """The verdict in a few lines, as `calib check` ends."""
        verdict = self.verdict
        head = f"Drift: {verdict}, score {self.score:.3g} (threshold 1), {self.samples} samples"
        return "\n  ".join([head, *self.explanations])

    @property
    def verdict(self) -> str:
        """The verdict in a few words."""
        if self.drifted:
            return "drifted"
        if self.drifted is None:
            return "too few rows to say" if self.too_few else "too coarse"
        return "still calibrated" if self.bound_holds else "the bound does not hold"

    @property
    def fired(self) -> tuple[str, ...]:
        """Names of the groups above their threshold, the most telling first."""
        return tuple(group.name for group in fired(self.groups))

    @property
    def explanations(self) -> tuple[str, ...]:
        """The causes in words."""
        return tuple(cause.words for cause in self.causes)

    def to_json(self) -> dict[str, Any]:
        """What `calib check --json` prints."""
        plain = (
            "drifted",
            "samples",
            "outliers",
            "left_out",
            "score",
            "smallest",
            "tolerance",
        )
        return {
            **{
                name: getattr(self, name)
                for name in (*plain, "adapts", "bound_holds", "covered")
            },
            "threshold": 1,
            "distortion": {
                name: asdict(signal) for name, signal in self.distortion.items()
            },
            "fired": list(self.fired),
            "causes": [cause.to_json() for cause in self.causes],
            "smallest_by_group": {g.name: g.smallest for g in self.groups},
            "explanations": list(self.explanations),
            "noise": {"now": self.noise, "usual": self.usual_noise},
            "false_alarm": FALSE_ALARM,
        }


def check(
    model: Model,
    log: Samples,
    *,
    cause: str | None = None,
    tolerance: float | None = None,
) -> Drift:
    """Compare new samples with a model.

    Parameters
    ----------
    model : Model
    log : Samples
        At least ten different rows of the same arm.
    cause : {"sensor", "joints"}, optional
        What is known about a change.
    tolerance : float, optional [unit]
        Where nothing fired and the rows could not have shown a change of this size, the
        answer is None.

    Returns
    -------
    Drift

    Raises
    ------
    LogError
        If the log is not of this arm, too short, or looks wrong.
    """
    verdict = judge(model, log, cause=cause, learn=False)
    drifted = verdict.changed
    too_few = drifted is None
    if drifted is False and tolerance is not None and verdict.smallest > tolerance:
        drifted = None
    return Drift(
        drifted=drifted,
        samples=len(verdict.rows),
        outliers=verdict.outliers,
        left_out=verdict.left_out,
        score=verdict.score,
        smallest=verdict.smallest,
        tolerance=tolerance,
        adapts=verdict.improves,
        groups=(*verdict.tests.groups, verdict.bound.test),
        distortion=_distortions(verdict.rows),
        noise=verdict.tests.noise,
        usual_noise=verdict.tests.usual,
        causes=verdict.causes,
        notes=verdict.notes,
        bound_holds=verdict.bound_holds,
        covered=verdict.covered,
        too_few=too_few,
        unit=verdict.unit_seen,
    )


def _distortions(rows: LogRows) -> dict[str, Signal]:
    """How the rows lie on the maps (eq. 9), beside what is usual there."""
    model = rows.model
    baseline = rows.model.baseline
    assert baseline is not None  # noqa: S101 - checked where the rows are read
    some = slice(None, None, math.ceil(len(rows) / _MOST))
    sensory = model.sensory
    measured = sensory.scale.to_unit(rows.x[some])
    predicted = sensory.scale.to_unit(rows.predicted[some])
    nodes = sensory.units[sensory.nearest(measured)[1][:, 0]]
    nodes_predicted = sensory.units[sensory.nearest(predicted)[1][:, 0]]
    away = search_tree(np.unique(nodes, axis=0), sensory.scale).query(nodes_predicted)[
        0
    ]
    usual = np.where(np.isfinite(rows.bound[some]), rows.bound[some], 0.0)
    return {
        "motor": _zeta(model.motor, rows.u[some], baseline.motor),
        "sensory": _zeta(sensory, measured, baseline.sensory),
        "reverse": Signal(float(np.mean(np.asarray(away) ** 2)), sensory.spacing**2),
        "links": Signal(_root_mean_square(rows.missed[some]), _root_mean_square(usual)),
    }


def _zeta(network: Map, points: Array, expected: Array) -> Signal:
    """Distortion (eq. 9) of points (n, p) in the unit box, beside the winners' own (nodes,)."""
    distance, winner = network.nearest(points)
    usual = expected[winner[:, 0]]
    return Signal(float(np.mean(distance[:, 0] ** 2)), float(usual.mean()))


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class ModelFit:
    """How a log fits one model."""

    index: int  # of the model in the list
    fits: bool  # whether `check` finds it still calibrated
    score: float  # that of `check`; infinite where it cannot be compared
    distance: float  # [unit], median distance from predicted to measured position

    def to_json(self) -> dict[str, Any]:
        """By name; infinite numbers are none."""
        return {k: None if v == np.inf else v for k, v in asdict(self).items()}


@dataclass(frozen=True)
class Recognition:
    """Which model a log fits.

    Attributes
    ----------
    index : int or None
        The model that fits best, None where each is contradicted.
    samples : int
        Rows of the log.
    fits : tuple of ModelFit
        All models, those that fit first, the nearest before the others.
    """

    index: int | None
    samples: int
    fits: tuple[ModelFit, ...]


def recognise(models: Sequence[Model], log: Samples) -> Recognition:
    """Tell which of some models a log fits; ten to thirty rows do.

    A model fits where `check` calls it still calibrated; of those the nearest to the rows answers.

    Parameters
    ----------
    models : sequence of Model
        One for each state of the arm.
    log : Samples
        Rows of the same arm.

    Raises
    ------
    OptionError
        If there is no model.
    LogError
        If the log can be compared with none of them.

    Examples
    --------
    >>> import calib
    >>> arm = calib.load_arm("two_link")
    >>> plain = calib.train(calib.babble(arm, 500, noise=1e-3), size=10)
    >>> log = calib.babble(arm, 60, seed=1, noise=1e-3, changes=["tip.offset=0.05,0"])
    >>> tool = calib.adapt(plain, log).model
    >>> calib.recognise([plain, tool], log.take(slice(30))).index
    1
    """
    if not len(models):
        raise OptionError("no models: give one or more, one for each state of the arm")
    found: list[ModelFit] = []
    why = None
    for index, model in enumerate(models):
        try:
            verdict = judge(model, log, learn=False)
        except LogError as error:  # outside of what this one has learned
            why = error
            found.append(ModelFit(index, False, np.inf, np.inf))
            continue
        distance = float(np.median(verdict.rows.missed))
        found.append(ModelFit(index, verdict.changed is False, verdict.score, distance))
    found.sort(key=lambda f: (not f.fits, f.distance))
    if why is not None and found[0].distance == np.inf:
        raise why
    return Recognition(
        found[0].index if found[0].fits else None, len(log), tuple(found)
    )
