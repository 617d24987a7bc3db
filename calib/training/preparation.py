"""Preparation: a log as it is learned from, with the body that its rows tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..body.approach import Approach
from ..common.arrays import Array
from ..common.rows import finite_rows, row_lengths
from ..common.wording import quantity
from ..errors import LogError, OptionError
from ..model.model import Model
from ..model.prediction import predict
from ..samples.misfit import align
from ..samples.repeatability import at_poses, noise_beside_poses
from ..samples.samples import Samples
from ..samples.settings import DIAGNOSIS
from .fitted_log import (
    FittedLog,
    contradictions,
    fit_sound_rows,
    in_time,
    play_words,
    without_play,
)
from .options import TrainingOptions
from .settings import DISAGREEMENT
from .smooth import SmoothPart, find_smooth_part, find_smooth_parts
from .touched import fit_sockets


@dataclass(frozen=True, eq=False)
class PreparedLog:
    """What is learned from: sound rows of one sensor, in time, and the body under the maps."""

    readings: Samples  # poses as often as they were read
    rows_given: int  # rows of the log before any was left out
    notes: list[str]  # of these rows
    part: SmoothPart | None  # of a row for each pose
    # (dof,), half the play of each joint, which the samples are freed of
    play: Array

    @cached_property
    def samples(self) -> Samples:
        """A row for each pose; of touches, whose sockets are positions, all."""
        touched = self.readings.touch is not None
        return self.readings if touched else at_poses(self.readings)

    @property
    def approach(self) -> Approach | None:
        """The play, where the direction of motion counts."""
        return Approach(self.play) if self.play.any() else None

    @property
    def left_out(self) -> int:
        """Number of the log's rows that are wrong; poses that were read again are not."""
        return self.rows_given - len(self.readings)


def _alone(samples: Samples, options: TrainingOptions) -> PreparedLog:
    """Leave wrong rows out, bring clocks together, and fit the body; a row a pose is left."""
    rows_given = len(samples) + samples.left_out
    no_play = np.zeros(samples.dof)
    if samples.touch is not None:
        samples, part, notes = fit_sockets(samples, samples.touch, options)
        return PreparedLog(samples, rows_given, notes, part, no_play)

    def fit(rows: Samples) -> SmoothPart:
        return find_smooth_part(at_poses(rows), options)

    simulation = samples.simulation
    if options.body == "none":
        notes = []
        if simulation is None or simulation.has_outliers:
            fitted = FittedLog.of(samples, fit).without_wrong_rows()
            samples = fitted.samples
            notes = [*fitted.notes]
        return PreparedLog(samples, rows_given, notes, None, no_play)
    fitted = fit_sound_rows(samples, fit)
    notes = [*fitted.notes]
    if fitted.play.any():
        notes.append(play_words(samples, fitted.play))
    part = _of_single_readings(fitted.part, fitted.samples)
    return PreparedLog(fitted.samples, rows_given, notes, part, fitted.play)


def prepare(
    logs: Mapping[str, Samples], options: TrainingOptions
) -> list[PreparedLog]:
    """Prepare the log of each sensor by itself, then fit one body to all of several."""
    alone = {name: _alone(log, options) for name, log in logs.items()}
    if len(alone) == 1:
        return [*alone.values()]
    # the arm's, whichever sensors have shown it
    plays = [log.play for log in alone.values() if log.play.any()]
    for name, log in alone.items():
        play = np.mean(plays, axis=0) if plays else log.play
        readings = without_play(log.readings, play - log.play)
        alone[name] = replace(log, readings=readings, play=play)
    poses = {name: log.samples for name, log in alone.items()}
    together = find_smooth_parts(poses, options)
    prepared = []
    for name, log in alone.items():
        part = _of_single_readings(together[name], log.readings)
        notes = [*log.notes, *_disagreement(log, part)]
        prepared.append(replace(log, part=part, notes=notes))
    return prepared


def _disagreement(log: PreparedLog, together: SmoothPart) -> list[str]:
    """Return a note where one body of all sensors misses this one's rows by far more than its own.

    log : with the part of its own
    """
    alone = log.part
    if alone is None or together.error < DISAGREEMENT * alone.error:
        return []
    unit = log.readings.unit
    return [
        f"sensor {log.readings.sensor} disagrees with the others about the arm: its held-out rows "
        f"are missed by {quantity(together.error, unit)}, by {quantity(alone.error, unit)} where "
        "it is fitted alone; check that its joints and positions are of the same arm"
    ]


def _of_single_readings(part: SmoothPart, samples: Samples) -> SmoothPart:
    """The smooth part with the noise of single readings, where it was fitted to means of them."""
    if samples.simulation is not None:
        return part
    repeat, hidden = noise_beside_poses(samples)
    if not hidden:
        return part
    body = part.fit.body
    second = body.second
    if second is not None:
        second = replace(second, noise=np.hypot(second.noise, hidden))
    noise = np.hypot(body.noise, hidden)
    body = replace(body, noise=noise, second=second, repeat=repeat)
    return replace(part, fit=replace(part.fit, body=body))


def logs_by_sensor(
    logs: Sequence[Samples], options: TrainingOptions
) -> dict[str, Samples]:
    """Name logs by their sensors; those of several get one range of the joints.

    Raises LogError or OptionError if they are not of one arm that several sensors measured.
    """
    if len(logs) == 1:
        return {logs[0].sensor: logs[0]}
    if options.body == "none":
        raise OptionError(
            "several sensors share a body: expected `body='auto'`",
            parameter="body",
        )
    if any(log.simulation or log.touch for log in logs):
        raise LogError(
            "one of several logs is of a simulation or of touches: expected measured "
            "positions; touches beside positions stand in one log"
        )
    logs = [log.reordered(logs[0].joint_names) for log in logs]
    lower = np.min([log.lower for log in logs], axis=0)
    upper = np.max([log.upper for log in logs], axis=0)
    by_sensor: dict[str, Samples] = {}
    for number, log in enumerate(logs, start=1):
        name = log.sensor or f"sensor {number}"
        if name in by_sensor:
            raise LogError(
                f"sensor {name} twice: expected a name of its own for each log"
            )
        by_sensor[name] = replace(log, sensor=name, lower=lower, upper=upper)
    return by_sensor


def sound_log(model: Model, samples: Samples) -> tuple[Samples, list[str]]:
    """A log that a model is compared with, in time and without rows that contradict the others.

    samples : in the model's unit; the arm or its sensor may have changed
    Returns the samples, their joints in the model's order, and notes.
    """
    about = model.about
    samples = replace(
        samples.reordered(about.joint_names),
        lower=about.lower,
        upper=about.upper,
        revolute=about.revolute,
    )
    notes: list[str] = []
    if model.body is not None:
        samples, notes = in_time(samples, model.body)
    predicted = predict(model, samples).value
    residual = samples.x - predicted
    answered = finite_rows(predicted)
    if answered.sum() < DIAGNOSIS.fewest_rows:
        return samples, notes
    # a sensor that was moved is no reason to leave rows out
    x = samples.x[answered]
    moved = x - align(predicted[answered], x, affine=samples.unit == "px")
    far = np.median(row_lengths(residual[answered]))
    if np.median(row_lengths(moved)) < 0.5 * far:
        residual[answered] = moved
    sound, wrong_notes = contradictions(samples, residual)
    left_out = samples.left_out + int(np.count_nonzero(~sound))
    return replace(samples.take(sound), left_out=left_out), notes + wrong_notes
