"""Checking: whether the map still fits the arm."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from ..maps.map import Map, search_tree
from .baseline import Baseline
from .causes import Evidence, find_causes
from .outliers import find_outliers, harmonics
from .sanity import comparable
from .systematic import FALSE_ALARM, Systematic, orthonormal, systematic

if TYPE_CHECKING:
    from ..model.model import Model
    from ..samples.samples import Samples

Array = NDArray[np.float64]

_SIGMAS = 4.0  # skewed as the distances are, chance exceeds so many once in 1,000
_DRAWS = 40  # undisturbed logs that are imagined for the reverse distortion
_MOST = 1000  # rows that it looks at
_GRAIN = 1e-6  # share of the extent below which nothing counts as drift


@dataclass(frozen=True)
class Signal:
    """One measure of drift.

    Attributes
    ----------
    value, threshold : float
        What was found, and what undisturbed logs stay below but for one in 1,000.
    """

    value: float
    threshold: float

    @property
    def score(self) -> float:
        """Value over threshold."""
        return self.value / self.threshold if self.threshold > 0 else float(self.value > 0)

    def to_json(self) -> dict[str, float]:
        """Value and threshold by name."""
        return {"value": self.value, "threshold": self.threshold}


@dataclass(frozen=True, eq=False)
class Drift:
    """What a log says of a model.

    Attributes
    ----------
    drifted : bool
        Whether one of the signals fired.
    samples : int
        Rows that were compared.
    outliers : int
        Rows that contradict all others; they are left out.
    distortion : dict of str to Signal
        "motor" and "sensory": the distortion zeta of the maps (eq. 9), in the unit box.
        "reverse": mean squared distance of the nodes predicted for the log's joints to
        those that its positions visit.  "links": root mean square of the systematic part
        of measured less predicted position [unit].
    noise, usual_noise : float [unit]
        Standard deviation per axis of the rest, now and in training.
    causes : tuple of str
        Every cause that explains the data: "noise", "sensor", "offset:JOINT",
        "length:JOINT", "geometry", "bent", "lost:JOINT", "workspace", or "unknown".
    explanations : tuple of str
        The same in words, with figures.
    notes : tuple of str
        What else the user should be told.
    """

    drifted: bool
    samples: int
    outliers: int
    distortion: dict[str, Signal]
    noise: float
    usual_noise: float
    causes: tuple[str, ...]
    explanations: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def score(self) -> float:
        """Largest value over threshold."""
        return max(signal.score for signal in self.distortion.values())

    @property
    def fired(self) -> tuple[str, ...]:
        """Signals above their threshold."""
        return tuple(name for name, signal in self.distortion.items() if signal.score > 1.0)

    def to_json(self) -> dict[str, Any]:
        """What `calib check --json` prints."""
        return {
            "drifted": self.drifted,
            "samples": self.samples,
            "outliers": self.outliers,
            "score": self.score,
            "threshold": 1,
            "distortion": {name: signal.to_json() for name, signal in self.distortion.items()},
            "fired": list(self.fired),
            "causes": list(self.causes),
            "explanations": list(self.explanations),
            "noise": {"now": self.noise, "usual": self.usual_noise},
            "false_alarm": FALSE_ALARM,
        }


def check(model: Model, log: Samples) -> Drift:
    """Compare new samples with a model.

    Parameters
    ----------
    model : Model
    log : Samples
        At least ten different rows of the same arm.

    Returns
    -------
    Drift

    Raises
    ------
    LogError
        If the log is not of this arm, too short, or looks wrong.
    """
    baseline = baseline_of(model)
    rows = comparable(model, log)
    kept = find_outliers(
        model.predictor.value, model.motor.scale, model.about.revolute, rows.u, rows.x
    )
    u, x = rows.u[kept], rows.x[kept]
    said = model.predictor.value(u)
    floor = own_error(model, u)
    basis = smooth_functions(model, u, said)
    part = systematic(basis, x - said, floor)
    scale = model.sensory.scale
    v = scale.to_unit(x)
    # noise moves samples across the border of the map
    leak = float(np.sum((part.noise / scale.span) ** 2))
    signals = {
        "motor": _zeta(model.motor, baseline.motor, baseline.spread[0], u, 0.0),
        "sensory": _zeta(model.sensory, baseline.sensory, baseline.spread[1], v, leak),
        "reverse": _reverse(model, said, x, max(part.noise, baseline.noise), floor),
        "links": Signal(part.value, part.threshold),
    }
    drifted = any(signal.score > 1.0 for signal in signals.values())
    evidence = Evidence(model, u, x, said, basis, floor, part)
    causes, words = find_causes(
        evidence, drifted, signals["reverse"].score > 1.0, _noisier(part, baseline, len(u), floor)
    )
    outliers = int(np.count_nonzero(~kept))
    notes = list(rows.notes)
    if outliers:
        rows_said = "1 row contradicts" if outliers == 1 else f"{outliers} rows contradict"
        notes.append(f"{rows_said} all others: left out")
    return Drift(
        drifted,
        len(u),
        outliers,
        signals,
        part.noise,
        baseline.noise,
        tuple(causes),
        tuple(words),
        tuple(notes),
    )


def baseline_of(model: Model) -> Baseline:
    """The baseline that a model brings, or one line that says that it brings none."""
    if model.baseline is None:
        raise ModelError("the model has no baseline of its distortions: train it again")
    return model.baseline


def own_error(model: Model, u: Array) -> float:
    """Root mean square error that the model may have of itself at `u` (n, dof) [unit]."""
    bound = np.nan_to_num(model.expected_error(model.motor.scale.from_unit(u)))
    extent = float(np.linalg.norm(model.sensory.scale.span))
    return max(0.5 * float(np.sqrt(np.mean(bound**2))), _GRAIN * extent)


def smooth_functions(model: Model, u: Array, said: Array) -> Array:
    """Functions that a change of arm or sensor is made of, orthonormal on the rows."""
    degree = 2 if len(u) >= 60 else 1
    turning, scale = model.about.revolute, model.motor.scale
    columns = [np.ones((len(u), 1)), said - said.mean(axis=0)]
    if len(u) >= 20:
        columns.append(harmonics(scale, turning, u, degree))
    return orthonormal(np.concatenate(columns, axis=1))


def _zeta(network: Map, expected: Array, spread: float, points: Array, leak: float) -> Signal:
    """Distortion of a map by some samples in its unit box (eq. 9)."""
    distance, winner = (part[:, 0] for part in network.nearest(points))
    # samples of one node are not independent
    independent = len(np.unique(winner))
    usual = expected[winner]
    chance = _SIGMAS * math.sqrt(spread * float(np.mean(usual**2)) / independent)
    return Signal(float(np.mean(distance**2)), float(usual.mean()) + chance + leak)


def _reverse(model: Model, said: Array, x: Array, noise: float, floor: float) -> Signal:
    """Distance of the nodes that joints predict to those that positions visit."""
    sensory = model.sensory
    some = slice(0, None, max(1, math.ceil(len(x) / _MOST)))
    said, x = said[some], x[some]
    predicted = sensory.units[sensory.nearest(sensory.scale.to_unit(said))[1][:, 0]]

    def away(points: Array) -> float:
        nodes = np.unique(sensory.nearest(sensory.scale.to_unit(points))[1][:, 0])
        tree = search_tree(sensory.units[nodes], sensory.scale)
        return float(np.mean(np.asarray(tree.query(predicted)[0]) ** 2))

    rng = np.random.default_rng(0)
    scatter = math.hypot(noise, floor)
    usual = [away(said + scatter * rng.standard_normal(said.shape)) for _ in range(_DRAWS)]
    chance = 4.0 * float(np.std(usual)) + 1.0 / len(x) * sensory.spacing**2
    return Signal(away(x), float(np.mean(usual)) + chance)


def _noisier(part: Systematic, baseline: Baseline, n: int, floor: float) -> bool:
    from scipy.special import fdtri

    usual = math.hypot(baseline.noise, floor)
    limit = float(fdtri(2 * n, 4000, 1.0 - FALSE_ALARM))
    return part.noise > 1.15 * usual * math.sqrt(limit)
