"""Sound rows of a log: in time, and without those that contradict the others."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..common.arrays import Array
from ..errors import LogError
from ..model.model import Model
from ..model.prediction import predict
from ..samples.delays import Trajectory
from ..samples.diagnosis import aligned, rows_behind
from ..samples.samples import Samples
from ..samples.settings import DIAGNOSIS
from ..samples.wrong_rows import contradictions, screen
from .late_clock import InTime, in_time
from .play import freed_of_play
from .smooth import Fit, SmoothPart


@dataclass(frozen=True, eq=False)
class SoundLog:
    """What is learned from: rows in time, and where their joints stood."""

    samples: Samples
    part: SmoothPart
    play: Array  # (dof,), half the play of each joint, which the samples are freed of
    notes: list[str] = field(default_factory=list)


def fit_sound_rows(samples: Samples, fit: Fit) -> SoundLog:
    """Fit samples; of a log without its delay and without the rows that contradict the others.

    Rows that came from the other side of a joint with play contradict the others, too: play is
    learned before.
    """
    if samples.simulation is not None:
        return SoundLog(*freed_of_play(samples, fit(samples), fit))
    notes: list[str] = []
    play = np.zeros(samples.dof)
    sound, wrong_notes = screen(samples)
    if (
        not sound.all() and Trajectory.of(samples) is None
    ):  # a lag looks like play
        freed, _, play = freed_of_play(samples, fit(samples), fit)
        if play.any():
            samples = freed
            sound, wrong_notes = screen(samples)
    samples = samples.take(sound)
    notes += wrong_notes
    trajectory = Trajectory.of(samples)
    delay = 0.0
    if samples.arm is not None and not samples.in_time:
        shift = rows_behind(
            samples.arm.forward, samples.q, samples.x, samples.unit
        )
        if trajectory is not None:
            delay = shift * trajectory.step
        elif shift:  # poses beside the positions of others
            rows = np.arange(max(shift, 0), len(samples) + min(shift, 0))
            samples = replace(samples.take(rows), q=samples.q[rows - shift])
            notes.append(
                f"positions are moved by {-shift:+d} rows to those of their joints"
            )
    part = fit(
        trajectory.moved(samples, delay) if trajectory and delay else samples
    )
    if trajectory is not None:
        mended: InTime = in_time(samples, trajectory, part.fit.body, delay, fit)
        samples = mended.samples
        part = mended.part or part
        notes += mended.notes
    samples, part, more = freed_of_play(samples, part, fit)
    play = play + more
    sound, wrong_notes = contradictions(samples, _residual(samples, part))
    if not sound.all():
        samples = samples.take(sound)
        samples, part, more = freed_of_play(samples, fit(samples), fit)
        play = play + more
    return SoundLog(samples, part, play, [*notes, *wrong_notes])


def _residual(samples: Samples, part: SmoothPart) -> Array:
    return samples.x - part.fit.body.predict(samples.q)


def sound_log(model: Model, samples: Samples) -> tuple[Samples, list[str]]:
    """A log that a model is compared with, in time and without rows that contradict the others.

    samples : in the model's unit; the arm or its sensor may have changed
    Returns the samples, their joints in the model's order, and notes.
    """
    if samples.touch is not None:
        raise LogError(
            "the log holds touches of sockets, whose places nobody measured: `calib.evaluate` "
            "tells how they scatter; train anew with them, and with those of before"
        )
    about = model.about
    samples = replace(
        samples.reordered(about.joint_names),
        lower=about.lower,
        upper=about.upper,
        revolute=about.revolute,
    )
    notes: list[str] = []
    trajectory = Trajectory.of(samples)
    if model.body is not None and trajectory is not None:
        mended = in_time(samples, trajectory, model.body)
        samples = mended.samples
        notes = mended.notes
    predicted = predict(model, samples.motion).value
    residual = samples.x - predicted
    answered = np.asarray(np.isfinite(predicted).all(axis=1))
    if answered.sum() < DIAGNOSIS.fewest_rows:
        return samples, notes
    # a sensor that was moved is no reason to leave rows out
    x = samples.x[answered]
    moved = x - aligned(predicted[answered], x, affine=samples.unit == "px")
    far = np.median(np.linalg.norm(residual[answered], axis=1))
    if np.median(np.linalg.norm(moved, axis=1)) < 0.5 * far:
        residual[answered] = moved
    sound, wrong_notes = contradictions(samples, residual)
    left_out = samples.left_out + int(np.count_nonzero(~sound))
    return replace(samples.take(sound), left_out=left_out), notes + wrong_notes
