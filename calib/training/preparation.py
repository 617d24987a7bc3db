"""Preparation: sound rows of each log, and the body that is fitted to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..body.body_fit import BodyFit
from ..body.covariance import Z95
from ..common.arrays import Array
from ..common.rows import diagonal, finite_rows, median_length
from ..common.wording import quantity
from ..errors import LogError, OptionError
from ..model.model import Model
from ..model.prediction import Prediction
from ..samples.misfit import align
from ..samples.repeatability import noise_beside_poses
from ..samples.samples import Samples
from ..samples.settings import DIAGNOSIS
from .bodies import fit_bodies, mean_error
from .fitted_log import (
    FittedLog,
    SoundLog,
    fit_sound_rows,
    play_words,
    samples_without_play,
)
from .late_clock import samples_in_time
from .options import TrainingOptions
from .settings import DISAGREEMENT, TESTING
from .socket_fit import fit_sockets
from .wrong_rows import contradictions


def prepare(
    logs: Sequence[Samples], options: TrainingOptions
) -> Sequence[SoundLog]:
    """Prepare the log of each sensor by itself, then fit one body to all of several.

    Raises LogError or OptionError if they are not of one arm that several sensors measured.
    """
    first, *others = logs
    if not others and first.touch is None and options.body == "none":
        return [_without_body(first, options)]
    if not others:
        log = _prepare_one_sensor(first, options)
        return [replace(log, notes=_notes_with_play(log))]
    given = _logs_by_sensor(logs, options)
    logs_by_sensor = {
        name: _prepare_one_sensor(log, options) for name, log in given.items()
    }
    prepared = _with_common_play(logs_by_sensor)
    poses = {name: log.samples for name, log in prepared.items()}
    fits = fit_bodies(poses, options)
    # each sensor's clock adds to the uncertainty of the common parameters
    covariances = [
        _clock_covariance(fits[name].body, samples)
        for name, samples in poses.items()
    ]
    covariance = np.sum(covariances, axis=0)
    repeats = _given_twice(given)
    return [
        _with_common_body(
            replace(log, notes=(*log.notes, *repeats[name])),
            _with_covariance(fits[name], covariance),
        )
        for name, log in prepared.items()
    ]


def _logs_by_sensor(
    logs: Sequence[Samples], options: TrainingOptions
) -> dict[str, Samples]:
    """Name logs of several sensors by these; they get one range of the joints."""
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


def _given_twice(logs: Mapping[str, Samples]) -> dict[str, list[str]]:
    """Notes on each sensor, of rows that are those of an earlier one to the last digit."""
    notes: dict[str, list[str]] = {}
    sensors: dict[bytes, str] = {}
    for name, log in logs.items():
        rows = [
            np.append(q, x).tobytes() for q, x in zip(log.q, log.x, strict=True)
        ]
        alike = [sensors[row] for row in rows if row in sensors]
        notes[name] = []
        if alike:
            notes[name].append(
                f"{len(alike)} of its {len(rows)} rows are those of {alike[0]}: a log that is "
                "given twice is no second sensor, and makes intervals too narrow"
            )
        sensors |= dict.fromkeys(rows, name)
    return notes


def _with_common_play(logs: Mapping[str, FittedLog]) -> dict[str, FittedLog]:
    """The sensors' logs with one play of the joints, the mean of all sensors that show it."""
    with_play = [log for log in logs.values() if log.half_play.any()]
    if not with_play:
        return dict(logs)
    half_play = np.average(
        [log.half_play for log in with_play],
        axis=0,
        weights=[_certainty(log) for log in with_play],
    )
    prepared = {}
    for name, log in logs.items():
        difference = half_play - log.half_play
        readings = samples_without_play(log.readings, difference)
        prepared[name] = replace(log, readings=readings, half_play=half_play)
    return prepared


def _certainty(log: FittedLog) -> float:
    """Weight of a sensor's rows: their number over the square of their relative error."""
    size = diagonal(log.samples.x)
    error = mean_error(log.fit) + 1e-12 * size
    return len(log.samples) * (size / error) ** 2


def _with_common_body(log: FittedLog, common_fit: BodyFit) -> FittedLog:
    """A sensor's log with the body of all sensors, and a note where that does not fit its rows."""
    fit = _with_noise_of_readings(common_fit, log.readings)
    notes = (*_notes_with_play(log), *_disagreement(log, fit))
    return replace(log, fit=fit, notes=notes)


def _without_body(samples: Samples, options: TrainingOptions) -> SoundLog:
    """The log for maps and links alone; a body finds its wrong rows."""
    simulation = samples.simulation
    rows_given = len(samples) + samples.left_out
    log = SoundLog(samples, rows_given, np.zeros(samples.dof), ())
    if simulation is not None and not simulation.has_outliers:
        return log
    fitted = FittedLog.of(samples, options).without_wrong_rows()
    return replace(log, readings=fitted.readings, notes=fitted.notes)


def _prepare_one_sensor(
    samples: Samples, options: TrainingOptions
) -> FittedLog:
    """The log of one sensor without wrong rows, its clocks aligned, and its body."""
    if samples.touch is not None:
        return fit_sockets(samples, samples.touch, options)
    log = fit_sound_rows(samples, options)
    fit = _with_noise_of_readings(log.fit, log.readings)
    covariance = _clock_covariance(fit.body, log.samples)
    return replace(log, fit=_with_covariance(fit, covariance))


def _notes_with_play(log: FittedLog) -> tuple[str, ...]:
    """The notes of a log, and one on the play of its joints."""
    if not log.half_play.any():
        return log.notes
    return (*log.notes, play_words(log.samples, log.half_play))


def _disagreement(log: FittedLog, common_fit: BodyFit) -> list[str]:
    """Return notes on a sensor whose scale, or whose rows, disagree with all sensors together.

    log : of the sensor, with a body of its own
    common_fit : of all sensors
    """
    body = common_fit.body
    sensor = body.structure.viewpoint
    (scale,) = body.structure.groups["view.scale"]
    notes = []
    if sensor.is_metric and scale in body.active:
        percent = 100.0 * np.expm1(body.beta[scale])
        half = 100.0 * Z95 * body.sds[scale]
        notes.append(
            f"lengths that it reads are {percent:+.3f} ± {half:.2g} % longer than the first "
            "sensor's: one of them is scaled, and the arm's size is as the first one says"
        )
    alone = mean_error(log.fit)
    error = mean_error(common_fit)
    if error < DISAGREEMENT * alone:
        return notes
    unit = log.readings.unit
    return [
        *notes,
        "it disagrees with the other sensors about the arm: its held-out rows are "
        f"missed by {quantity(error, unit)}, by {quantity(alone, unit)} where "
        "it is fitted alone; check that its joints and positions are of the same arm",
    ]


def _with_noise_of_readings(fit: BodyFit, samples: Samples) -> BodyFit:
    """The fit to means of readings with the noise of single readings."""
    if samples.simulation is not None:
        return fit
    repeat, hidden = noise_beside_poses(samples)
    if not hidden:
        return fit
    noise = np.hypot(fit.body.noise, hidden)
    body = replace(fit.body, noise=noise, repeat=repeat)
    return replace(fit, body=body)


def _clock_covariance(body: Body, samples: Samples) -> Array:
    """Covariance (k, k) of a body's parameters by the standard deviation of its rows' clock.

    A clock that moves the rows by v changes the parameters along C J' v, with their covariance C
    and the derivatives J, both over the noise.  Correlated residuals make C too large, so the
    change ends where J times it is closest to v.  Without it three models of 9 s paths, of 180 rows
    each, took their unchanged arm for drifted; with it one does.
    """
    if samples.clock_sd is None:
        return np.zeros_like(body.covariance)
    structure = body.structure
    _, slope = structure.predict_and_slope(samples.q, body.beta)
    _, columns = structure.linearise(samples.q, body.beta, body.active)
    columns = columns / body.noise[:, None]
    moves = np.einsum("nmd,nd->nm", slope, samples.clock_sd) / body.noise
    change = body.covariance @ np.einsum("nmk,nm->k", columns, moves)
    predicted = columns @ change
    square = max(float((predicted**2).sum()), 1e-300)
    length = float((predicted * moves).sum()) / square
    change *= min(length, 1.0)
    return np.outer(change, change)


def _with_covariance(fit: BodyFit, covariance: Array) -> BodyFit:
    """The fit with a further covariance (k, k) of its parameters."""
    if not covariance.any():
        return fit
    body = fit.body.with_covariance(fit.body.active, covariance)
    return replace(fit, body=body)


def sound_log(model: Model, samples: Samples) -> tuple[Samples, list[str]]:
    """A log for a comparison with a model, its clocks aligned, without wrong rows.

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
        samples, notes = samples_in_time(samples, model.body)
    predicted = Prediction(model, samples).value
    residual = samples.x - predicted
    answered = finite_rows(predicted)
    if answered.sum() < DIAGNOSIS.fewest_rows:
        return samples, notes
    # rows of a sensor that was moved are not wrong
    x = samples.x[answered]
    in_frame = x - align(predicted[answered], x, affine=samples.unit == "px")
    limit = TESTING.nearer * median_length(residual[answered])
    if median_length(in_frame) < limit:
        residual[answered] = in_frame
    sound, wrong_notes = contradictions(samples, residual)
    left_out = samples.left_out + int(np.count_nonzero(~sound))
    return replace(samples.take(sound), left_out=left_out), notes + wrong_notes
