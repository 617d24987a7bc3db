"""A log made ready for learning: sound rows in time, without play, and their body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..body.approach import Approach, OtherColumns, learn_half_play
from ..body.belief import Body
from ..body.body_fit import BodyFit
from ..common.arrays import Array, Index
from ..common.rows import thinned
from ..common.wording import unit_of_joint
from ..maps.predictor import BodyInBox
from ..samples.delays import Trajectory
from ..samples.repeatability import at_poses
from ..samples.samples import Samples
from .bodies import fit_body
from .late_clock import samples_in_time
from .options import TrainingOptions
from .settings import BACKLASH
from .wrong_rows import contradictions


@dataclass(frozen=True, eq=False)
class SoundLog:
    """What maps are learned from: the sound rows of one sensor."""

    readings: Samples  # poses as often as they were read
    rows_given: int  # rows of the log before any was left out
    # (dof,) [rad or m], half the play of each joint, which the readings are without
    half_play: Array
    notes: tuple[str, ...]

    @cached_property
    def samples(self) -> Samples:
        """A row for each pose; of touches, whose sockets are positions, all."""
        touched = self.readings.touch is not None
        return self.readings if touched else at_poses(self.readings)

    @property
    def approach(self) -> Approach | None:
        """The play, where the direction of motion counts."""
        return Approach(self.half_play) if self.half_play.any() else None

    @property
    def left_out(self) -> int:
        """Number of the log's rows that are wrong; poses that were read again are not."""
        return self.rows_given - len(self.readings)


@dataclass(frozen=True, eq=False)
class FittedLog(SoundLog):
    """A log with the body that is fitted to its poses."""

    fit: BodyFit
    options: TrainingOptions

    @staticmethod
    def of(samples: Samples, options: TrainingOptions) -> FittedLog:
        """The log with all its rows."""
        rows_given = len(samples) + samples.left_out
        half_play = np.zeros(samples.dof)
        fit = fit_body(at_poses(samples), options)
        return FittedLog(samples, rows_given, half_play, (), fit, options)

    @property
    def rows(self) -> Index:
        """Rows (k,) of the samples that the body is fitted to: of a long log every k-th."""
        numbers = np.arange(len(self.samples))
        return numbers[thinned(len(numbers), len(self.fit.held_out))]

    @property
    def body(self) -> BodyInBox:
        """The body, as a function of the joints' unit box."""
        return BodyInBox(self.fit.body, self.samples.unit_box)

    def of_readings(self, readings: Samples, *notes: str) -> FittedLog:
        """The log with other readings, and a new fit to them."""
        fit = fit_body(at_poses(readings), self.options)
        notes = (*self.notes, *notes)
        return replace(self, readings=readings, fit=fit, notes=notes)

    def without_wrong_rows(self) -> FittedLog:
        """The log without the rows that contradict the others; a simulation without its outliers.

        The fit of a simulation gives outliers full weight: each new fit reveals a few more.
        """
        samples = self.readings
        simulation = samples.simulation
        if simulation is not None and not simulation.has_outliers:
            return self
        residual = samples.x - self.fit.body.predict(samples.q)
        sound, notes = contradictions(samples, residual)
        if sound.all():
            return self
        log = self.of_readings(samples.take(sound), *notes)
        return log if simulation is None else log.without_wrong_rows()

    def in_time(self) -> FittedLog:
        """The log with its clocks aligned, where a delay is clear."""
        readings, notes = samples_in_time(
            self.readings, self.fit.body, fresh=True
        )
        if readings is self.readings:
            return self
        # fitted anew: the curves have followed the delay
        return self.of_readings(readings, *notes)

    def without_play(self) -> FittedLog:
        """The log without the play that its order shows."""
        log = self
        # repeated, since curves and frame have absorbed some of it
        for _ in range(BACKLASH.rounds):
            half_play = _half_play_of(log)
            if half_play is None:
                break
            difference = half_play - log.half_play
            largest = np.abs(difference).max()
            if largest <= BACKLASH.settled * half_play.max():
                break
            readings = samples_without_play(log.readings, difference)
            log = replace(log.of_readings(readings), half_play=half_play)
        return log


def fit_sound_rows(samples: Samples, options: TrainingOptions) -> FittedLog:
    """Fit samples without wrong rows, play and, of a log, the delay of its clock."""
    fitted = FittedLog.of(samples, options)
    if samples.simulation is not None:
        return fitted.without_wrong_rows().without_play()
    # first the play, by which rows from one side of a joint contradict those from the other;
    # along a path it comes later, since a delay looks like play
    if Trajectory.of(samples) is None:
        fitted = fitted.without_play()
    fitted = fitted.without_wrong_rows().in_time().without_play()
    # again, with the better fit
    return fitted.without_wrong_rows()


def _half_play_of(log: FittedLog) -> Array | None:
    """Half the play of each joint (dof,) [rad or m], None where the rows' order shows none."""
    samples = log.samples
    simulation = samples.simulation
    exact = simulation is not None and not simulation.hidden
    if len(log.rows) < BACKLASH.fewest or exact:
        return None
    samples = samples.take(log.rows[thinned(len(log.rows), BACKLASH.most)])
    if samples.side is None:
        return None
    body = log.fit.body
    structure = body.structure
    predicted, slope = structure.predict_and_slope(samples.q, body.beta)
    slope /= body.noise[:, None]
    residual = structure.residual(samples.x, predicted) / body.noise
    others = _other_columns(samples, body, slope)
    return learn_half_play(residual, slope, samples.side, others, log.half_play)


def _other_columns(samples: Samples, body: Body, slope: Array) -> OtherColumns:
    """Parameters estimated together with the play: all that the body may free, and joints' curves.

    Elasticity, gears and couplings absorb half of a play along a path, where joints seldom turn;
    the curve of a joint absorbs it near a limit, which the joint mostly reaches from one side.

    slope : (n, m, dof) [1 / rad or m], derivative of the positions in noises by the joints
    """
    structure = body.structure
    prior = body.prior(structure.blocks_but_curves)
    free = prior.active
    _, columns = structure.linearise(samples.q, body.beta, free)

    u = np.clip(samples.unit_box.to_unit(samples.q), 0.0, 1.0)
    powers = np.polynomial.chebyshev.chebvander(2.0 * u - 1.0, BACKLASH.trend)
    curves = np.einsum("nmk,nkp->nmkp", slope, powers)
    curves = curves.reshape(*slope.shape[:2], -1)
    count = curves.shape[2]
    return OtherColumns(
        np.concatenate([columns / body.noise[:, None], curves], axis=2),
        precision_root=np.append(1.0 / prior.sd[free], np.ones(count)),
        pull=np.append((prior.mean - body.beta)[free], np.zeros(count)),
    )


def samples_without_play(samples: Samples, half_play: Array) -> Samples:
    """Return the samples with the joints' true values, rather than what their encoders read.

    half_play : (dof,), half the play of each joint [rad or m]
    """
    assert samples.side is not None  # noqa: S101 - as samples are made
    return replace(samples, q=samples.q - half_play * samples.side)


def play_words(samples: Samples, half_play: Array) -> str:
    """One line about the backlash that the order of the rows shows."""
    backlash = []
    joints = zip(samples.joint_names, half_play, samples.revolute, strict=True)
    for name, half, revolute in joints:
        factor, unit = unit_of_joint(revolute, True)
        if half > 0.0:
            backlash.append(f"{name} {2 * factor * half:.3g} {unit}")
    return (
        f"the direction of approach counts, backlash of {', '.join(backlash)}: give it to forward "
        "for smaller errors, else the expected error covers both sides"
    )
