"""Preparation: a log as it is learned from, with the body that its rows tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from ..errors import LogError, OptionError
from ..samples.repeatability import at_poses, noise_beside_poses
from ..samples.samples import Samples
from .learn import TrainingOptions
from .smooth import SmoothPart, find_smooth_part, find_smooth_parts
from .sound_rows import fit_sound_rows, play_words, sound_beside, without_play
from .touched import fit_sockets


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is learned from: sound rows of one sensor, in time, and the body under the maps."""

    samples: Samples  # a row for each pose
    rows_given: int  # rows of the log before any was left out
    notes: tuple[str, ...]
    part: SmoothPart | None = None
    # (dof,), half the play of each joint, which the samples are freed of
    play: Array | None = None
    # of the same poses, each as often as it was read
    readings: Samples | None = None

    @property
    def left_out(self) -> int:
        """Number of the log's rows that are wrong; poses that were read again are not."""
        used = self.samples if self.readings is None else self.readings
        return self.rows_given - len(used)


def _alone(samples: Samples, options: TrainingOptions) -> Prepared:
    """Leave wrong rows out, bring clocks together, and fit the body; a row a pose is left."""
    rows_given = len(samples) + samples.left_out
    if samples.touch is not None:
        samples, part, notes = fit_sockets(samples, samples.touch, options)
        return Prepared(samples, rows_given, (*notes, *part.fit.notes), part)

    def fit(rows: Samples) -> SmoothPart:
        return find_smooth_part(at_poses(rows), options)

    if options.body == "none":
        notes = []
        if samples.simulation is None:
            sound, notes = sound_beside(samples, fit(samples))
            samples = samples.take(sound)
        return Prepared(at_poses(samples), rows_given, tuple(notes))
    samples, part, play, notes = fit_sound_rows(samples, fit)
    if play.any():
        notes.append(play_words(samples, play))
    return Prepared(
        at_poses(samples),
        rows_given,
        (*notes, *part.fit.notes),
        _of_single_readings(part, samples),
        play if play.any() else None,
        samples,
    )


def prepare(
    logs: Mapping[str, Samples], options: TrainingOptions
) -> list[Prepared]:
    """Prepare the log of each sensor by itself, then fit one body to all of several."""
    alone = [_alone(samples, options) for samples in logs.values()]
    if len(alone) == 1:
        return alone
    # the arm's, whichever sensors have shown it
    plays = [log.play for log in alone if log.play is not None]
    play = np.mean(plays, axis=0) if plays else None
    readings: dict[str, Samples] = {}
    for name, log in zip(logs, alone, strict=True):
        samples = log.readings or log.samples
        if play is not None:
            rest = play if log.play is None else play - log.play
            samples = without_play(samples, rest)
        readings[name] = samples
    poses = {name: at_poses(samples) for name, samples in readings.items()}
    parts = find_smooth_parts(poses, options)
    together = []
    for name, log in zip(logs, alone, strict=True):
        part = _of_single_readings(parts[name], readings[name])
        notes_of_fit = log.part.fit.notes if log.part else ()
        notes = [note for note in log.notes if note not in notes_of_fit]
        together.append(
            replace(
                log,
                samples=poses[name],
                part=part,
                play=play,
                notes=(*notes, *part.fit.notes),
            )
        )
    return together


def _of_single_readings(part: SmoothPart, samples: Samples) -> SmoothPart:
    """The smooth part with the noise of single readings, where it was fitted to medians of them."""
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
    fit = replace(part.fit, body=body)
    return replace(part, fit=fit, smooth=replace(part.smooth, body=body))


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
