"""Residuals: errors of every readout in both directions, row by row, and their sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array, Index
from ..common.choices import MAP_READOUTS
from ..common.parallel import side_by_side
from ..common.rows import row_lengths
from ..errors import LogError
from ..model.answers import unit_joints
from ..model.model import Model
from ..model.prediction import predict
from ..samples.motion import Motion
from ..samples.simulation import Simulation
from .fitted_log import FittedLog, SoundLog
from .maps import maps_of
from .options import TrainingOptions
from .settings import TESTING
from .touch_scatter import NOT_LEARNED

Sizes = dict[str, float]
"""Mean, largest and 99th percentile of some errors, as "mean", "max" and "p99"."""

ErrorTable = dict[str, dict[str, dict[str, Sizes]]]
"""Sizes by readout, direction ("forward" or "inverse") and coordinate."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Predicted less true values, row by row."""

    motion: Motion  # (n, dof), joints that training never saw
    x: Array  # (n, m), positions there
    # of each readout: predicted less true positions (n, m) [unit], answered less true joints
    # (n, dof) [rad or m], distance (n,) [unit] from each target to where the answer really leads
    forward: dict[str, Array]
    inverse: dict[str, Array]
    distance: dict[str, Array]
    joint_names: tuple[str, ...]
    left_out: int = 0  # rows that lie outside of what was learned
    turned: Array | None = None  # (n,) [rad], errors of the body's orientation
    # (n,), by which bounds on errors of the body are wider than the model's: of rows held out
    widening: Array | float = 1.0

    @property
    def errors(self) -> dict[str, Array]:
        """Distance between predicted and true position, (n,) per readout."""
        return {
            readout: row_lengths(error)
            for readout, error in self.forward.items()
        }


def _residuals(
    model: Model,
    motion: Motion,
    x: Array,
    forward: dict[str, Array],
    answers: dict[str, Array],
    truth: Callable[[Array], Array] | None = None,
) -> Residuals:
    """Residuals of predictions less positions, and of answered less true joints.

    forward, answers : of each readout, errors (n, m) [unit], and joints (n, dof) in the unit box
    truth : the true kinematics; without it (a log) the learned map tells how far the answered
        joints lead from the recorded ones
    """
    scale = model.motor.scale
    value = model.predictor.value
    u = scale.to_unit(motion.q)
    targets = value(u) if truth is None else x
    inverse = {}
    distance = {}
    for readout, answer in answers.items():
        inverse[readout] = scale.difference(answer, u) * scale.span
        reached = truth(scale.from_unit(answer)) if truth else value(answer)
        distance[readout] = row_lengths(reached - targets)
    names = model.about.joint_names
    return Residuals(motion, x, forward, inverse, distance, names)


def evaluate_residuals(
    model: Model,
    motion: Motion,
    x: Array,
    truth: Callable[[Array], Array] | None = None,
) -> Residuals:
    """Residuals of all readouts in both directions, of the answer nearest to the true joints."""
    answered = model.covers(motion.q)
    if not answered.any():
        raise LogError(NOT_LEARNED)
    motion = motion.take(answered)
    x = x[answered]
    prediction = predict(model, motion)
    near = model.solver.newton.clip(model.motor.scale.to_unit(motion.q))
    # the answers' bounds, of which `Model.solve` takes most of the time, are not asked for
    predicted, answers = side_by_side(
        lambda: {name: prediction.read(name) for name in model.readouts},
        lambda: unit_joints(model, x, near, model.readouts),
    )
    forward = {readout: value - x for readout, value in predicted.items()}
    residuals = _residuals(model, motion, x, forward, answers, truth)
    return replace(residuals, left_out=int(np.count_nonzero(~answered)))


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
    forward: dict[str, Array] = {}
    turned = None
    widening: Array | float = 1.0
    if isinstance(log, FittedLog) and held_out is not None:
        sample = slice(None, None, max(1, len(held_out) // TESTING.body))
        fit = log.fit
        rows = log.rows[sample]
        forward["local"] = -held_out[sample]
        widening = fit.widening[sample]
        if "body" in model.readouts:
            forward["body"] = -fit.held_out[sample]
        if fit.turned is not None:
            turned = fit.turned[sample]
    q = samples.q[rows]
    x = samples.x[rows]
    answers = _answers_to_missed(model, q, forward)
    maps_forward, maps_answers = _cross_validated_maps(
        model, log, options, rows
    )
    residuals = _residuals(
        model, Motion(q), x, forward | maps_forward, answers | maps_answers
    )
    return replace(residuals, turned=turned, widening=widening)


def _answers_to_missed(
    model: Model, q: Array, forward: dict[str, Array]
) -> dict[str, Array]:
    """Answers (n, dof) in the unit box to targets that held-out predictions miss by `forward`.

    They are the joints near `q` (n, dof) that the learned map leads as far from the target.
    """
    u = model.motor.scale.to_unit(q)
    near = model.solver.newton.clip(u)
    reached = model.predictor.value(u)
    return {
        readout: unit_joints(model, reached - error, near, ("local",))["local"]
        for readout, error in forward.items()
    }


def _cross_validated_maps(
    model: Model,
    log: SoundLog,
    options: TrainingOptions,
    rows: Index,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Errors (k, m) and answers (k, dof) of the maps' readouts at some rows (k,).

    Twice maps learn one half of the blocks of a log and are tested on the other.
    """
    samples = log.samples
    q = samples.q[rows]
    x = samples.x[rows]
    clip = model.solver.newton.clip
    near = clip(model.motor.scale.to_unit(q))
    errors = {readout: np.empty_like(x) for readout in MAP_READOUTS}
    answers = {readout: np.empty_like(q) for readout in MAP_READOUTS}
    numbers = np.arange(len(samples))
    blocks = np.array_split(numbers, TESTING.folds)
    in_odd_block = np.isin(numbers, np.concatenate(blocks[1::2]))
    for unseen in (in_odd_block, ~in_odd_block):
        tested = unseen[rows]
        pair = maps_of(log, options, np.flatnonzero(~unseen))
        targets = pair.sensory.scale.to_unit(x[tested])
        inverses = pair.inverses(targets, near[tested])
        for readout in MAP_READOUTS:
            predicted = pair.predict(q[tested], readout)
            errors[readout][tested] = predicted - x[tested]
            answers[readout][tested] = clip(inverses[readout])
    return errors, answers


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
    """Joints (n, dof) and true positions (n, 2) of the 10,000 points that test a seed's models."""
    rng = np.random.default_rng(TrainingOptions(seed=seed).stream("evaluation"))
    q = simulation.draw(TESTING.fresh, rng)
    return q, simulation.true(q, rng)


def summarise(residuals: Residuals) -> ErrorTable:
    """Mean, largest and 99th percentile of the absolute errors, per readout and direction."""
    table: ErrorTable = {}
    for readout, gap in residuals.forward.items():
        forward = dict(zip("xyz", gap.T, strict=False))
        forward["distance"] = row_lengths(gap)
        if residuals.turned is not None and readout in ("local", "body"):
            forward["orientation"] = residuals.turned
        answers = residuals.inverse[readout].T
        inverse = dict(zip(residuals.joint_names, answers, strict=True))
        inverse["distance"] = residuals.distance[readout]
        directions = {"forward": forward, "inverse": inverse}
        table[readout] = {
            direction: {name: error_sizes(e) for name, e in errors.items()}
            for direction, errors in directions.items()
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
    """
    errors = residuals.errors[model.default_readout]
    bound = residuals.widening * predict(model, residuals.motion).bound
    answered = np.isfinite(bound)
    rounding = 1e-12  # of an exact arm both are
    inside = errors[answered] <= bound[answered] + rounding
    within = {
        "p95": float(np.quantile(errors, 0.95)),
        "covered": float(inside.mean()) if len(inside) else 1.0,
    }
    if not answered.all():
        within["answered"] = float(answered.mean())
    return within
