"""Bounds: 95 % of a new model's errors, and these themselves, by rows that it has not learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.covariance import RADIUS_95
from ..common.arrays import Array
from ..common.parallel import side_by_side
from ..common.rows import row_lengths
from ..maps.node_bounds import learn_bounds
from ..model.about import MeasuredRows
from ..model.baseline import Baseline, RowPlaces, learn_baseline
from ..model.model import Model
from ..model.parts import bounds_of_nodes
from ..samples.motion import directions
from ..samples.samples import Samples
from ..samples.simulation import Simulation
from .fitted_log import FittedLog, SoundLog
from .options import TrainingOptions
from .residuals import Residuals, fresh_residuals, held_out_residuals
from .settings import TESTING


def tested_on_log(
    model: Model,
    log: SoundLog,
    held_out: Array | None,
    options: TrainingOptions,
) -> tuple[Model, Residuals]:
    """A model of a log with bounds by rows that were held out, and the errors there.

    held_out : (k, m) [unit], what the default readout leaves over of the rows of the body
    """
    samples = log.samples
    residuals = held_out_residuals(model, log, held_out, options)
    motor = model.motor
    u = motor.scale.to_unit(residuals.motion.q)
    errors = residuals.distances(model.default_readout)
    reading, position = node_bounds(model, u, errors)
    rows = log.rows if isinstance(log, FittedLog) else slice(None)
    baseline = _baseline(model, samples, u, residuals.x)
    if model.body is None:
        baseline = replace(baseline, seen=RowPlaces.of(motor.scale, u))
    model = replace(
        model,
        bounds=reading,
        model_bounds=position,
        rows=MeasuredRows.of(samples.q[rows], samples.x[rows], held_out),
        baseline=baseline,
    )
    return model, residuals


def tested_on_arm(
    model: Model,
    simulation: Simulation,
    log: SoundLog,
    options: TrainingOptions,
) -> tuple[Model, Residuals]:
    """A model of a simulated arm with bounds by exact samples, and the errors at others."""
    seed = options.stream("bounds")
    (nodes, u, x), residuals = side_by_side(
        lambda: _simulation_bounds(model, simulation, log.half_play, seed),
        lambda: fresh_residuals(model, simulation),
    )
    model = replace(
        model,
        bounds=nodes,
        model_bounds=nodes,
        baseline=_baseline(model, log.samples, u, x),
        approach=log.approach,
    )
    return model, residuals


def _baseline(model: Model, samples: Samples, u: Array, x: Array) -> Baseline:
    """What distortions of an undisturbed arm look like, of samples that it has not learned.

    u, x : (k, dof) in the unit box and (k, m) [unit], joints and positions of these
    """
    every = max(1, len(samples) // TESTING.baseline)
    learned = model.motor.scale.to_unit(samples.q[::every])
    residual = model.predictor.value(learned) - samples.x[::every]
    return learn_baseline(model.association, u, x, row_lengths(residual))


def node_bounds(model: Model, u: Array, errors: Array) -> tuple[Array, Array]:
    """Bounds (nodes,) of a log's model on what the sensor reads and on the true position.

    A body's are its posterior's.  Without one, and in defects, they are learned from the errors
    (k,) [unit] of rows that were held out, at `u` (k, dof) in the unit box.
    """
    motor = model.motor
    body = model.body
    if body is None:
        learned = learn_bounds(motor, u, errors)
        # they hold at the rows, see `calib.model.parts`
        return learned, learned
    reading, position = bounds_of_nodes(motor, body)
    if model.predictor.models.degree < 0:
        return reading, position
    # where held-out rows are further off than the body predicts, as in a local defect
    learned = learn_bounds(motor, u, errors)
    noise = RADIUS_95 * float(np.sqrt(np.mean(body.noise[:2] ** 2)))
    defect = np.sqrt(np.maximum(learned**2 - noise**2, 0.0))
    position = np.where(
        learned > reading, np.maximum(position, defect), position
    )
    return np.maximum(reading, learned), position


def _simulation_bounds(
    model: Model,
    simulation: Simulation,
    half_play: Array,
    seed: np.random.SeedSequence,
) -> tuple[Array, Array, Array]:
    """Bounds (nodes,) [unit] by exact samples that are neither learned nor tested.

    half_play : (dof,), half the play of each joint, where the side of approach is known
    Returns bounds, and joints (k, dof) in the unit box and positions (k, m) of these samples
    """
    rng = np.random.default_rng(seed)
    q = simulation.draw(TESTING.draws, rng)
    x = simulation.true(q, rng)
    q = q - half_play * directions(q)
    inside = model.covers(q)
    u = model.motor.scale.to_unit(q[inside])
    errors = row_lengths(model.predictor.value(u) - x[inside])
    nodes = learn_bounds(model.motor, u, errors)
    rounding = TESTING.rounding * model.solver.extent
    return np.maximum(nodes, rounding), u, x[inside]
