"""Bounds: 95 % of a new model's errors, and these themselves, by rows that it has not learned."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.covariance import RADIUS_95
from ..common.arrays import Array
from ..common.parallel import side_by_side
from ..common.rows import row_lengths
from ..maps.node_bounds import learn_bounds
from ..model.about import MeasuredRows
from ..model.model import Model
from ..model.parts import bounds_of_nodes
from ..samples.motion import directions
from ..samples.simulation import Simulation
from .options import TrainingOptions
from .preparation import PreparedLog
from .residuals import Residuals, fresh_residuals, held_out_residuals
from .settings import TESTING


@dataclass(frozen=True, eq=False)
class Tested:
    """A model with bounds, and the rows by which they were found."""

    model: Model
    residuals: Residuals  # of all its readouts
    u: Array  # (k, dof), joints of rows that it has not learned, in the unit box
    x: Array  # (k, m) [unit], positions there


def errors_on_log(
    model: Model,
    prepared: PreparedLog,
    held_out: Array | None,
    options: TrainingOptions,
) -> Tested:
    """Test a model of a log on rows that were held out.

    held_out : (k, m) [unit], what the default readout leaves over of the rows of the body
    """
    samples = prepared.samples
    part = prepared.part
    residuals = held_out_residuals(model, samples, part, held_out, options)
    u = model.motor.scale.to_unit(residuals.motion.q)
    errors = residuals.errors[model.default_readout]
    reading, position = node_bounds(model, u, errors)
    rows = slice(None) if part is None else part.rows
    measured = MeasuredRows.of(samples.q[rows], samples.x[rows], held_out)
    model = replace(model, bounds=reading, model_bounds=position, rows=measured)
    return Tested(model, residuals, u, residuals.x)


def errors_on_arm(
    model: Model,
    simulation: Simulation,
    prepared: PreparedLog,
    options: TrainingOptions,
) -> Tested:
    """Test a model of a simulated arm on exact samples that it has not learned."""
    seed = options.stream("bounds")
    (nodes, u, x), residuals = side_by_side(
        lambda: _simulation_bounds(model, simulation, prepared.play, seed),
        lambda: fresh_residuals(model, simulation),
    )
    model = replace(
        model,
        bounds=nodes,
        model_bounds=nodes,
        approach=prepared.approach,
    )
    return Tested(model, residuals, u, x)


def node_bounds(model: Model, u: Array, errors: Array) -> tuple[Array, Array]:
    """Bounds (nodes,) of a log's model on what the sensor reads and on the true position.

    A body's are its posterior's.  Without one, and in defects, they are learned from the errors
    (k,) [unit] of rows that were held out, at `u` (k, dof) in the unit box.
    """
    motor = model.motor
    body = model.body
    if body is None:
        learned = learn_bounds(motor, u, errors)
        # they hold beside the rows, see `calib.model.parts`
        return learned, learned
    reading, position = bounds_of_nodes(motor, body)
    if model.predictor.models.degree >= 0:
        # where held-out rows are further off than the body says, as in a local defect
        learned = learn_bounds(motor, u, errors)
        noise = RADIUS_95 * float(np.sqrt(np.mean(body.noise[:2] ** 2)))
        defect = np.sqrt(np.maximum(learned**2 - noise**2, 0.0))
        position = np.where(
            learned > reading, np.maximum(position, defect), position
        )
        reading = np.maximum(reading, learned)
    return reading, position


def _simulation_bounds(
    model: Model,
    simulation: Simulation,
    play: Array,
    seed: np.random.SeedSequence,
) -> tuple[Array, Array, Array]:
    """Bounds (nodes,) [unit] by exact samples that are neither learned nor tested.

    play : (dof,), half the play of each joint, where the direction of approach is known
    Returns bounds, and joints (k, dof) in the unit box and positions (k, m) of these samples
    """
    rng = np.random.default_rng(seed)
    q = simulation.draw(TESTING.drawn, rng)
    x = simulation.true(q, rng)
    q = q - play * directions(q)
    inside = model.covers(q)
    u = model.motor.scale.to_unit(q[inside])
    errors = row_lengths(model.predictor.value(u) - x[inside])
    nodes = learn_bounds(model.motor, u, errors)
    rounding = TESTING.rounding * model.solver.extent
    return np.maximum(nodes, rounding), u, x[inside]
