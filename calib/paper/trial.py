"""Trials: one network, one schedule, several seeds, and the errors of each readout."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..maps.association import Association
from ..maps.density import Gain
from ..model.about import Errors
from ..samples.motion import Motion
from ..samples.samples import Samples
from ..training.maps import associate
from ..training.options import TrainingOptions
from ..training.residuals import (
    ReadoutErrors,
    Residuals,
    fresh_points,
    summarise,
)
from .setting import Setting

_EPOCHS = (20, 40)
_SIGMAS = (0.4, 0.7, 1.0, 1.5, 2.0)
# candidates that every seed judges: one seed alone is one map's luck
_FINALISTS = 4

Row = dict[str, dict[str, dict[str, float]]]
"""{readout: {column: {"mean", "max", "p99", "mean_spread", "max_spread", ...}}} [m, rad]."""


@dataclass(frozen=True)
class Schedule:
    """How a network is trained."""

    # passes over the samples, None for coarse to fine
    epochs: int | None = None
    # last neighbourhood radius [nodes]; the first is half the lattice
    sigma: float | None = None
    links: str = "reciprocal"  # a name of :data:`calib.maps.links.WIRINGS`
    rule: str = "batch"  # {"batch", "online"}, training rule

    def radii(self, side: int) -> tuple[float, float] | None:
        """First and last radius on a lattice of `side` nodes along each axis [nodes]."""
        if self.sigma is None:
            return None
        return max(side / 2, self.sigma), self.sigma

    def __str__(self) -> str:
        if self.epochs is None and self.sigma is None:
            return f"coarse to fine, {self.links} links"
        return f"{self.epochs} epochs, last sigma {self.sigma:g}, {self.links} links"


SAME_SCHEDULE = Schedule(20, 2.0)
"""The schedule at which the paper's ratio of SOM to VDSOM appears."""


class Candidate(NamedTuple):
    """A schedule and its score: mean error of the four columns, as a share of the ranges."""

    schedule: Schedule
    score: float


@dataclass(frozen=True)
class SeedErrors:
    """Errors of one seed."""

    # {readout: {"forward" | "inverse": {column: {"mean", "max", "p99"}}}}
    errors: Errors
    ranges: Mapping[str, float]  # width of what each column covers [m, rad]


@dataclass(frozen=True)
class NetworkTrial:
    """A network and its schedule."""

    network: str | Gain  # see :class:`calib.SOM`
    schedule: Schedule
    side: int  # nodes along each side of both lattices

    def row(self, setting: Setting) -> Row:
        """Errors of all seeds, on 10,000 exact test points for each seed."""
        errors = [
            self.errors(setting.babble(seed), seed) for seed in setting.seeds
        ]
        return row_of_seeds(errors)

    def errors(self, samples: Samples, seed: int) -> SeedErrors:
        """Errors of one seed, on the points on which ``calib train`` tests a model of it."""
        pair = association(
            samples, self.network, self.schedule, self.side, seed
        )
        simulation = samples.simulation
        assert simulation is not None  # noqa: S101
        q, x = fresh_points(simulation, seed)
        scale = pair.motor.scale
        u = scale.to_unit(q)
        targets = pair.sensory.scale.to_unit(x)
        by_readout = {}
        for readout, answer in pair.inverses(targets, u).items():
            answer = np.clip(answer, 0.0, 1.0)
            forward = pair.predict(q, readout) - x
            missed = simulation.exact(scale.from_unit(answer)) - x
            by_readout[readout] = ReadoutErrors.of(
                scale, u, forward, answer, missed
            )
        names = samples.joint_names
        residuals = Residuals(Motion(q), x, by_readout, names)
        # widths of what the samples cover, and of the joints' limits
        widths = np.concatenate(
            [np.ptp(samples.x, axis=0), samples.upper - samples.lower]
        )
        ranges = dict(
            zip(("x", "y", *samples.joint_names), widths.tolist(), strict=True)
        )
        return SeedErrors(summarise(residuals), ranges)


def row_of_seeds(results: Sequence[SeedErrors]) -> Row:
    """One row of several seeds: mean over the seeds, and their standard deviation.

    "mean_of_range" and "max_of_range" are the errors as shares of the coordinate's range.
    """
    row: Row = {}
    for readout, directions in results[0].errors.items():
        row[readout] = {}
        for direction, columns in directions.items():
            for column in columns:
                cells = [
                    result.errors[readout][direction][column]
                    for result in results
                ]
                cell = _mean_cell(cells)
                if column == "distance":
                    row[readout][f"{direction}_distance"] = cell
                    continue
                width = float(
                    np.mean([result.ranges[column] for result in results])
                )
                cell["mean_of_range"] = cell["mean"] / width
                cell["max_of_range"] = cell["max"] / width
                row[readout][column] = cell
    return row


def _mean_cell(cells: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean over the seeds of each statistic, and how far the seeds spread."""
    cell = {
        name: float(np.mean([c[name] for c in cells]))
        for name in ("mean", "max", "p99")
    }
    for name in ("mean", "max"):
        cell[f"{name}_spread"] = float(np.std([c[name] for c in cells]))
    return cell


def association(
    samples: Samples,
    network: str | Gain,
    schedule: Schedule,
    side: int,
    seed: int,
) -> Association:
    """Both maps and their links alone, as ``calib train`` would learn them."""
    scale = samples.unit_box
    options = TrainingOptions(
        side,
        map=network,
        rule=schedule.rule,
        epochs=schedule.epochs,
        sigma=schedule.radii(side),
        links=schedule.links,
        seed=seed,
    )
    with one_blas_thread():
        return associate(scale, scale.to_unit(samples.q), samples.x, options)


def activity_errors(pair: Association, q: Array, x: Array) -> Array:
    """Absolute errors of the readout ``activity``, (n, 2 + dof) as shares of the ranges."""
    motor = pair.motor.scale
    u = motor.to_unit(q)
    v = pair.sensory.scale.to_unit(x)
    forward = pair.forward(u, "activity") - v
    inverse = motor.difference(
        np.clip(pair.inverses(v, u)["activity"], 0.0, 1.0), u
    )
    return np.abs(np.hstack([forward, inverse]))


def best_schedule(setting: Setting, network: str) -> list[Candidate]:
    """Schedules of one network by their validation error, the best first.

    The readout is ``activity``.  Successive halving (Jamieson and Talwalkar, AISTATS 2016): each
    seed judges the better half of what the seeds before it left, down to a few finalists.  A
    candidate that stayed longer comes before one that was dropped earlier.
    """
    candidates = schedules(setting)
    dropped: list[Candidate] = []
    scores: dict[Schedule, list[float]] = {
        schedule: [] for schedule in candidates
    }
    ranking: list[Candidate] = []
    for k, seed in enumerate(setting.seeds):
        samples = setting.babble(seed)
        q, x = setting.validation(samples, seed)
        for n, schedule in enumerate(candidates):
            pair = association(samples, network, schedule, setting.side, seed)
            scores[schedule].append(float(activity_errors(pair, q, x).mean()))
            share = (k + (n + 1) / len(candidates)) / len(setting.seeds)
            setting.report(share, f"{network}: {schedule}")
        judged = [
            Candidate(schedule, float(np.mean(scores[schedule])))
            for schedule in candidates
        ]
        ranking = sorted(judged, key=lambda result: result.score)
        if k + 1 < len(setting.seeds):
            half = max(_FINALISTS, math.ceil(len(ranking) / 2))
            dropped = ranking[half:] + dropped
            candidates = [result.schedule for result in ranking[:half]]
    return ranking + dropped


def schedules(setting: Setting) -> list[Schedule]:
    """The schedules that are compared, the same for every network."""
    if setting.quick:
        return [Schedule(), Schedule(10, 1.0)]
    compared = [Schedule()]
    compared += [
        Schedule(epochs, sigma) for epochs in _EPOCHS for sigma in _SIGMAS
    ]
    # one bandwidth and one-sided links for the shortest of each: they are behind everywhere
    compared.append(Schedule(links="oja"))
    compared += [Schedule(_EPOCHS[0], sigma, "oja") for sigma in _SIGMAS]
    return compared


@lru_cache(maxsize=8)
def best_trial(
    setting: Setting, network: str
) -> tuple[NetworkTrial, list[Candidate]]:
    """The network at its own best schedule, and all that were compared."""
    ranking = best_schedule(setting, network)
    return NetworkTrial(network, ranking[0].schedule, setting.side), ranking
