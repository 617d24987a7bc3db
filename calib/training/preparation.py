"""Preparation: a log as it is learned from, with the body that its rows tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..body.approach import learn_play
from ..body.belief import Body
from ..common.arrays import Array, Mask
from ..common.rows import finite_rows, row_lengths
from ..common.wording import sized, unit_of_joint
from ..errors import LogError, OptionError
from ..model.model import Model
from ..model.prediction import predict
from ..samples.delays import Delay, Trajectory, estimate_delay
from ..samples.diagnosis import aligned
from ..samples.motion import directions
from ..samples.repeatability import at_poses, noise_beside_poses
from ..samples.samples import Samples
from ..samples.settings import DIAGNOSIS
from ..samples.wrong_rows import contradictions
from .options import TrainingOptions
from .settings import DISAGREEMENT, LATE_CLOCK, PLAY
from .smooth import Fit, SmoothPart, find_smooth_part, find_smooth_parts
from .touched import fit_sockets


@dataclass(frozen=True, eq=False)
class Prepared:
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
    def left_out(self) -> int:
        """Number of the log's rows that are wrong; poses that were read again are not."""
        return self.rows_given - len(self.readings)


def _alone(samples: Samples, options: TrainingOptions) -> Prepared:
    """Leave wrong rows out, bring clocks together, and fit the body; a row a pose is left."""
    rows_given = len(samples) + samples.left_out
    play = np.zeros(samples.dof)
    if samples.touch is not None:
        samples, part, notes = fit_sockets(samples, samples.touch, options)
        return Prepared(samples, rows_given, notes, part, play)

    def fit(rows: Samples) -> SmoothPart:
        return find_smooth_part(at_poses(rows), options)

    if options.body == "none":
        notes = []
        if samples.simulation is None:
            sound, notes = sound_beside(samples, fit(samples))
            samples = samples.take(sound)
        elif samples.simulation.has_outliers:
            part = fit(samples)
            samples, _, notes = _without_outliers(samples, part, fit)
        return Prepared(samples, rows_given, notes, None, play)
    samples, part, play, notes = fit_sound_rows(samples, fit)
    if play.any():
        notes.append(play_words(samples, play))
    part = _of_single_readings(part, samples)
    return Prepared(samples, rows_given, notes, part, play)


def prepare(
    logs: Mapping[str, Samples], options: TrainingOptions
) -> list[Prepared]:
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


def _disagreement(log: Prepared, together: SmoothPart) -> list[str]:
    """Return a note where one body of all sensors misses this one's rows by far more than its own.

    log : with the part of its own
    """
    alone = log.part
    if alone is None or together.error < DISAGREEMENT * alone.error:
        return []
    unit = log.readings.unit
    return [
        f"sensor {log.readings.sensor} disagrees with the others about the arm: its held-out rows "
        f"are missed by {sized(together.error, unit)}, by {sized(alone.error, unit)} where it is "
        "fitted alone; check that its joints and positions are of the same arm"
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


def fit_sound_rows(
    samples: Samples, fit: Fit
) -> tuple[Samples, SmoothPart, Array, list[str]]:
    """Fit samples; of a log without its delay and without the rows that contradict the others.

    Rows that came from the other side of a joint with play contradict the others, too: play is
    learned before.
    Returns the samples as they are learned from, in time and with their joints where they stood,
    their part, half the play of each joint (dof,) that they are freed of, and notes.
    """
    part = fit(samples)
    if samples.simulation is not None:
        samples, part, notes = _without_outliers(samples, part, fit)
        return *freed_of_play(samples, part, fit), notes
    play = np.zeros(samples.dof)
    sound, notes = sound_beside(samples, part)
    if not sound.all():
        if Trajectory.of(samples) is None:  # a lag looks like play
            samples, part, play = freed_of_play(samples, part, fit)
            sound, notes = sound_beside(samples, part)
        samples = samples.take(sound)
        part = fit(samples)
    samples, moved_part, clock_notes = in_time(samples, part.fit.body, fit)
    samples, part, more = freed_of_play(samples, moved_part or part, fit)
    play = play + more
    sound, wrong_notes = sound_beside(samples, part)
    if not sound.all():
        samples = samples.take(sound)
        samples, part, more = freed_of_play(samples, fit(samples), fit)
        play = play + more
    return samples, part, play, [*notes, *clock_notes, *wrong_notes]


def _without_outliers(
    samples: Samples, part: SmoothPart, fit: Fit
) -> tuple[Samples, SmoothPart, list[str]]:
    """Return simulated samples without a sensor's outliers, their part, and notes.

    The fit of a simulation believes every row: it finds a few outliers more each time.
    """
    simulation = samples.simulation
    notes: list[str] = []
    while simulation is not None and simulation.has_outliers:
        sound, more = sound_beside(samples, part)
        if sound.all():
            break
        samples = samples.take(sound)
        part = fit(samples)
        notes += more
    return samples, part, notes


def sound_beside(samples: Samples, part: SmoothPart) -> tuple[Mask, list[str]]:
    """Which rows (n,) do not contradict the others beside a fit, and notes."""
    residual = samples.x - part.fit.body.predict(samples.q)
    return contradictions(samples, residual)


def freed_of_play(
    samples: Samples, part: SmoothPart, fit: Fit
) -> tuple[Samples, SmoothPart, Array]:
    """Return samples without the play that their order shows, their part, and half the play.

    part : of the samples as they are
    """
    play = np.zeros(samples.dof)
    # curves and frame have taken a part of it before
    for _ in range(PLAY.rounds):
        more = _play_of(at_poses(samples), part)
        if more is None:
            break
        samples = without_play(samples, more)
        part = fit(samples)
        play = play + more
    return samples, part, play


def _play_of(samples: Samples, part: SmoothPart) -> Array | None:
    """Half the play of each joint (dof,) [rad or m], None where the rows' order shows none."""
    simulation = samples.simulation
    exact = simulation is not None and not simulation.hidden
    if len(part.rows) < PLAY.fewest or exact or samples.side is None:
        return None
    rows = part.rows[:: -(-len(part.rows) // PLAY.most)]
    scale = part.smooth.scale
    u = scale.to_unit(samples.q[rows])
    value, slope = part.smooth.value_and_slope(u)
    # a joint near a limit mostly came from one side: its curve has taken that part already
    surprise = samples.side[rows].copy()
    for k, values in enumerate(np.clip(u, 0.0, 1.0).T):
        powers = np.polynomial.chebyshev.chebvander(
            2.0 * values - 1.0, PLAY.trend
        )
        trend = np.linalg.lstsq(powers, surprise[:, k])[0]
        surprise[:, k] -= powers @ trend
    return learn_play(samples.x[rows] - value, slope / scale.span, surprise)


def without_play(samples: Samples, play: Array) -> Samples:
    """Return the samples with the joints where they stood, rather than what they read."""
    assert samples.side is not None  # noqa: S101 - as samples are made
    return replace(samples, q=samples.q - play * samples.side)


def play_words(samples: Samples, play: Array) -> str:
    """One line about the backlash that the order of the rows shows."""
    backlash = []
    joints = zip(samples.joint_names, play, samples.revolute, strict=True)
    for name, half, turns in joints:
        factor, unit = unit_of_joint(turns, True)
        if half > 0.0:
            backlash.append(f"{name} {2 * factor * half:.3g} {unit}")
    return (
        f"the direction of approach counts, backlash of {', '.join(backlash)}: give it to forward "
        "for smaller errors, else the expected error covers both sides"
    )


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
        samples, _, notes = in_time(samples, model.body)
    predicted = predict(model, samples).value
    residual = samples.x - predicted
    answered = finite_rows(predicted)
    if answered.sum() < DIAGNOSIS.fewest_rows:
        return samples, notes
    # a sensor that was moved is no reason to leave rows out
    x = samples.x[answered]
    moved = x - aligned(predicted[answered], x, affine=samples.unit == "px")
    far = np.median(row_lengths(residual[answered]))
    if np.median(row_lengths(moved)) < 0.5 * far:
        residual[answered] = moved
    sound, wrong_notes = contradictions(samples, residual)
    left_out = samples.left_out + int(np.count_nonzero(~sound))
    return replace(samples.take(sound), left_out=left_out), notes + wrong_notes


def in_time(
    samples: Samples, body: Body, fit: Fit | None = None
) -> tuple[Samples, SmoothPart | None, list[str]]:
    """Bring the clocks of a log along a path together where a delay is clear.

    fit : fits the body anew to moved samples; without it the body is that of another log
    Returns the samples with their joints at the times of their positions, the part of moved ones
        where they were fitted, and notes.
    """
    trajectory = Trajectory.of(samples)
    if trajectory is None:
        return samples, None, []
    delay = _delay(samples, trajectory, body, fresh=fit is not None)
    if delay is None or not delay.clear:
        return samples, None, []
    moved = trajectory.moved(samples, delay.value)
    # with curves that have not followed the delay
    part = None if fit is None else fit(moved)
    return moved, part, [delay.note()]


def _delay(
    samples: Samples,
    trajectory: Trajectory,
    body: Body,
    *,
    fresh: bool,
) -> Delay | None:
    """Estimate a delay together with the chain and its frame.

    fresh : whether the body was fitted to these rows as they are: then its curves may have followed
        the delay along a path, and are left out
    """
    structure = body.structure
    if structure.outputs != samples.x.shape[1]:
        return None
    members = structure.members()
    prior = structure.prior(dict(members).get("chain", members[0][1]))
    active = prior.active
    beta = body.beta.copy()
    if fresh:
        beta[prior.sd == 0] = prior.mean[prior.sd == 0]
    middle = len(trajectory.time) // 2
    half = LATE_CLOCK.rows // 2
    some = slice(max(0, middle - half), middle + half)
    total = 0.0
    share = 0.0
    for _ in range(LATE_CLOCK.steps):
        q, speed = trajectory.before(total)
        q = q[some]
        inside = finite_rows(q)
        if inside.mean() < 0.5:
            return None
        q = q[inside]
        seen, slope = structure.predict_and_slope(q, beta)
        step = estimate_delay(
            structure.residual(samples.x[some][inside], seen),
            np.einsum("nmk,nk->nm", slope, speed[some][inside]),
            structure.linearise(q, beta, active)[1],
            prior.sd[active] ** -2.0,
            (prior.mean - beta)[active],
            # joints with play err by their direction
            play=slope * directions(q)[:, None],
            unit=trajectory.unit,
        )
        if step is None:
            return None
        delay, change = step
        share = share or delay.share
        moved = np.zeros(len(beta))
        moved[active] = change
        beta = structure.retract(beta, moved)
        total += delay.value
        if abs(delay.value) < LATE_CLOCK.settled * delay.sd:
            break
    return Delay(total, delay.sd, delay.unit, share)
