"""Bounds: 95 % of a model's errors around each motor node, by rows that it has not learned."""

from __future__ import annotations

import numpy as np

from ..body.covariance import RADIUS_95
from ..common.arrays import Array
from ..common.rows import row_lengths
from ..errors import OptionError
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..samples.motion import directions
from ..samples.simulation import Simulation
from .options import UNFOLD
from .settings import TESTING


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
    q = motor.scale.from_unit(np.clip(motor.units, 0.0, 1.0))
    reading = body.bound(q)
    position = body.bound(q, noise=False)
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


def simulation_bounds(
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
    if not inside.any():
        raise OptionError(
            "no test sample is near the motor map's nodes", hint=UNFOLD
        )
    u = model.motor.scale.to_unit(q[inside])
    errors = row_lengths(model.predictor.value(u) - x[inside])
    nodes = learn_bounds(model.motor, u, errors)
    rounding = TESTING.rounding * model.solver.extent
    return np.maximum(nodes, rounding), u, x[inside]
