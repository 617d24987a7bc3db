"""Residuals: errors of every readout in both directions, row by row, and their sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.choices import MAP_READOUTS
from ..common.parallel import side_by_side
from ..common.rows import row_lengths
from ..common.scale import Scale
from ..errors import LogError
from ..model.answers import unit_joints
from ..model.model import Model
from ..model.prediction import Prediction
from ..samples.motion import Motion
from ..samples.repeatability import at_poses
from ..samples.samples import Samples
from ..samples.simulation import Simulation
from .fitted_log import FittedLog, SoundLog
from .maps import maps_of
from .options import TrainingOptions
from .settings import TESTING
from .socket_places import NOT_LEARNED

Sizes = dict[str, float]
"""Mean, largest and 99th percentile of some errors, as "mean", "max" and "p99"."""

ErrorTable = dict[str, dict[str, dict[str, Sizes]]]
"""Sizes by readout, direction ("forward" or "inverse") and coordinate."""


class ReadoutErrors(NamedTuple):
    """Errors of a readout, row by row."""

    forward: Array  # (n, m) [unit], predicted less true positions
    inverse: Array  # (n, dof) [rad or m], answered less true joints
    # (n,) [unit], from each target to where the answer really leads
    distance: Array

    @staticmethod
    def of(
        scale: Scale,
        u: Array,
        forward: Array,
        answer: Array,
        misses: Array,
    ) -> ReadoutErrors:
        """Errors of answers (n, dof), which miss their targets by (n, m) [unit].

        u, answer : (n, dof), true and answered joints in the unit box of `scale`
        """
        inverse = scale.difference(answer, u) * scale.span
        return ReadoutErrors(forward, inverse, row_lengths(misses))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Predicted less true values, row by row."""

    motion: Motion  # (n, dof), joints that training never saw
    x: Array  # (n, m), positions there
    by_readout: dict[str, ReadoutErrors]
    joint_names: tuple[str, ...]
    left_out: int = 0  # rows that lie outside of what was learned
    # (n,) [rad], errors of the body's orientation
    orientation: Array | None = None
    # (n,), factor on the model's bound for errors of held-out rows
    widening: Array | float = 1.0

    def distances(self, readout: str) -> Array:
        """Distances (n,) [unit] between predicted and true positions of a readout."""
        return row_lengths(self.by_readout[readout].forward)


def evaluate_residuals(
    model: Model,
    motion: Motion,
    x: Array,
    truth: Callable[[Array], Array] | None = None,
) -> Residuals:
    """Residuals of all readouts in both directions, of the answer nearest to the true joints.

    truth : the true kinematics; without it (a log) the learned map predicts how far the answered
        joints lead from the recorded ones
    """
    answered = model.covers(motion.q)
    if not answered.any():
        raise LogError(NOT_LEARNED)
    motion = motion.take(answered)
    x = x[answered]
    prediction = Prediction(model, motion)
    scale = model.motor.scale
    u = scale.to_unit(motion.q)
    near = model.solver.newton.clip(u)
    # without the answers' bounds, which take most of the time of `Model.solve`
    predicted, answers = side_by_side(
        lambda: {name: prediction.read(name) for name in model.readouts},
        lambda: unit_joints(model, x, near, model.readouts),
    )
    value = model.predictor.value
    targets = value(u) if truth is None else x
    by_readout = {}
    for readout, position in predicted.items():
        answer = answers[readout]
        reached = truth(scale.from_unit(answer)) if truth else value(answer)
        by_readout[readout] = ReadoutErrors.of(
            scale, u, position - x, answer, reached - targets
        )
    names = model.about.joint_names
    left_out = int(np.count_nonzero(~answered))
    return Residuals(motion, x, by_readout, names, left_out)


def held_out_residuals(
    model: Model,
    log: SoundLog,
    held_out: Array | None,
    options: TrainingOptions,
) -> Residuals:
    """Residuals of all readouts on rows of a log that were held out in contiguous blocks.

    held_out : (k, m), what the default readout leaves over of the body's rows
    """
    samples = log.samples
    rows = np.arange(0, len(samples), max(1, len(samples) // TESTING.maps))
    errors: dict[str, Array] = {}
    orientation = None
    widening: Array | float = 1.0
    if isinstance(log, FittedLog) and held_out is not None:
        sample = slice(None, None, max(1, len(held_out) // TESTING.body))
        fit = log.fit
        rows = log.rows[sample]
        errors["local"] = -held_out[sample]
        widening = fit.widening[sample]
        if "body" in model.readouts:
            errors["body"] = -fit.held_out[sample]
        if fit.orientation_errors is not None:
            orientation = fit.orientation_errors[sample]
    q = samples.q[rows]
    scale = model.motor.scale
    u = scale.to_unit(q)
    near = model.solver.newton.clip(u)
    value = model.predictor.value
    targets = value(u)
    answered = {}
    # the joints at which the learned map is off by the errors
    for readout, error in errors.items():
        answers = unit_joints(model, targets - error, near, ("local",))
        answered[readout] = (error, answers["local"])
    answered |= _cross_validated_maps(model, log, options, rows)
    by_readout = {}
    for readout, (error, answer) in answered.items():
        misses = value(answer) - targets
        by_readout[readout] = ReadoutErrors.of(scale, u, error, answer, misses)
    return Residuals(
        Motion(q),
        samples.x[rows],
        by_readout,
        model.about.joint_names,
        orientation=orientation,
        widening=widening,
    )


def _cross_validated_maps(
    model: Model, log: SoundLog, options: TrainingOptions, rows: Index
) -> dict[str, tuple[Array, Array]]:
    """Errors (k, m), and answers (k, dof) in the unit box, of the maps' readouts at some rows (k,).

    Maps of every other block of the log are tested on the blocks between, and the other way round.
    """
    samples = log.samples
    q = samples.q[rows]
    x = samples.x[rows]
    clip = model.solver.newton.clip
    near = clip(model.motor.scale.to_unit(q))
    by_readout = {
        readout: (np.empty_like(x), np.empty_like(q))
        for readout in MAP_READOUTS
    }
    numbers = np.arange(len(samples))
    blocks = np.array_split(numbers, TESTING.folds)
    in_odd_block = np.isin(numbers, np.concatenate(blocks[1::2]))
    for unseen in (in_odd_block, ~in_odd_block):
        tested = unseen[rows]
        pair = maps_of(log, options, np.flatnonzero(~unseen))
        targets = pair.sensory.scale.to_unit(x[tested])
        inverses = pair.inverses(targets, near[tested])
        for readout, (error, answer) in by_readout.items():
            error[tested] = pair.predict(q[tested], readout) - x[tested]
            answer[tested] = clip(inverses[readout])
    return by_readout


def fresh_residuals(model: Model, simulation: Simulation) -> Residuals:
    """Residuals on true positions of the simulated arm that training never saw.

    10,000, or 300 where maps alone answer for more than three joints.
    """
    q, x = fresh_points(simulation, model.about.seed)
    if model.body is None and q.shape[1] > 3:
        q = q[: TESTING.fresh_of_maps]
        x = x[: TESTING.fresh_of_maps]
    return evaluate_residuals(model, Motion(q), x, simulation.exact)


def fresh_points(simulation: Simulation, seed: int) -> tuple[Array, Array]:
    """Joints (n, dof) and true positions (n, m) of the 10,000 points that test a seed's models."""
    rng = np.random.default_rng(TrainingOptions(seed=seed).stream("evaluation"))
    q = simulation.draw(TESTING.fresh, rng)
    return q, simulation.true(q, rng)


def summarise(residuals: Residuals) -> ErrorTable:
    """Mean, largest and 99th percentile of the absolute errors, per readout and direction."""
    table: ErrorTable = {}
    for readout, errors in residuals.by_readout.items():
        forward = dict(zip("xyz", errors.forward.T, strict=False))
        forward["distance"] = row_lengths(errors.forward)
        if residuals.orientation is not None and readout in ("local", "body"):
            forward["orientation"] = residuals.orientation
        names = residuals.joint_names
        inverse = dict(zip(names, errors.inverse.T, strict=True))
        inverse["distance"] = errors.distance
        directions = {"forward": forward, "inverse": inverse}
        table[readout] = {
            direction: {
                name: error_sizes(error) for name, error in columns.items()
            }
            for direction, columns in directions.items()
        }
    return table


def error_sizes(error: Array) -> Sizes:
    """Mean, largest and 99th percentile of the absolute errors (n,)."""
    size = np.abs(error)
    return {
        "mean": float(size.mean()),
        "max": float(size.max()),
        "p99": float(np.quantile(size, 0.99)),
    }


def p95_and_coverage(model: Model, residuals: Residuals) -> dict[str, float]:
    """The 95th percentile of the errors [unit], and the share that the model's own bound covers.

    Both are of the rows that the model answers; "answered" is their share where it is not all.
    Fewer than ten rows give no share.
    """
    errors = residuals.distances(model.default_readout)
    bound = (
        residuals.widening * Prediction(model, residuals.motion).reading_bound
    )
    answered = np.isfinite(bound)
    rounding = 1e-12  # of an exact arm both are
    inside = errors[answered] <= bound[answered] + rounding
    within = {"p95": float(np.quantile(errors, 0.95))}
    if len(inside) >= TESTING.fewest:
        within["covered"] = float(inside.mean())
    if not answered.all():
        within["answered"] = float(answered.mean())
    return within


def learned_rows(model: Model, samples: Samples) -> Mask:
    """Which rows (n,) of a log a model has learned: those with a reading of one of its rows.

    Readings have enough digits that no two different rows have the same.
    """
    rows = model.rows
    width = samples.x.shape[1]
    if (
        rows is None
        or samples.unit != model.about.unit
        or width != rows.x.shape[1]
    ):
        return np.zeros(len(samples), dtype=bool)
    readings = {reading.tobytes() for reading in rows.x}
    pose_is_learned = np.array(
        [x.tobytes() in readings for x in at_poses(samples).x]
    )
    if (
        model.about.samples > len(rows)
        and pose_is_learned.sum() > len(rows) // 2
    ):
        # of a long log a model keeps some rows alone
        return np.ones(len(samples), dtype=bool)
    return np.asarray(pose_is_learned[samples.pose_index])
