"""Bounds of a model's answers at its nodes: of a simulation, of a log, and with backlash."""

from __future__ import annotations

import numpy as np

from ..body.approach import learn_play
from ..body.covariance import RADIUS_95
from ..common.arrays import Array
from ..errors import OptionError
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..samples.joint_values import directions
from ..samples.samples import Samples
from ..samples.simulation import Simulation
from .learn import UNFOLD
from .smooth import SmoothPart

_ROUNDING = (
    4e-15  # share of the extent: what an answer in double precision is sure of at best
)
_DRAWN = 12_000  # exact samples that the bounds of a simulation are learned from
# rows that play is learned from
_LEAST = 20
_ROWS = 5_000
_TREND = 7  # degree of what a joint's value tells of its direction


def node_bounds(model: Model, u: Array, errors: Array) -> tuple[Array, Array]:
    """Bounds (nodes,) of a log's model on what the sensor reads and on the true position.

    A body's are its posterior's.  Without one, and in defects, they are learned from the errors
    (k,) [unit] of rows that were held out, at `u` (k, dof) in the unit box.
    """
    motor = model.motor
    if model.body is None:
        learned = learn_bounds(motor, u, errors)
        return learned, learned  # they hold beside the rows, see `calib.model.parts`
    q = motor.scale.from_unit(np.clip(motor.units, 0.0, 1.0))
    reading, position = (model.body.bound(q, noise=noise) for noise in (True, False))
    if model.predictor.models.degree >= 0:
        # where held-out rows are further off than the body says, as in a local defect
        learned = learn_bounds(motor, u, errors)
        noise = RADIUS_95 * float(np.sqrt(np.mean(model.body.noise[:2] ** 2)))
        own = np.sqrt(np.maximum(learned**2 - noise**2, 0.0))
        position = np.where(learned > reading, np.maximum(position, own), position)
        reading = np.maximum(reading, learned)
    return reading, position


def simulated_bounds(
    model: Model,
    simulation: Simulation,
    play: Array | None,
    seed: np.random.SeedSequence,
) -> tuple[Array, Array, Array]:
    """Bounds (nodes,) by exact samples that are neither learned nor tested, and these samples.

    play : (dof,), half the play of each joint, where the direction of approach is known
    """
    scale = model.motor.scale
    rng = np.random.default_rng(seed)
    q = simulation.draw(_DRAWN, rng)
    x = simulation.true(q, rng)
    side = directions(q)
    stand = q if play is None else q - play * side
    u = scale.to_unit(stand)
    inside = model.covers(stand)
    if not inside.any():
        raise OptionError("no test sample is near the motor map's nodes", hint=UNFOLD)
    errors = np.linalg.norm(model.predictor.value(u) - x, axis=1)
    bounds = learn_bounds(model.motor, u[inside], errors[inside])
    bounds = np.maximum(bounds, _ROUNDING * model.solver.extent)
    return bounds, u[inside], x[inside]


def play_of(samples: Samples, part: SmoothPart) -> Array | None:
    """Half the play of each joint (dof,) [rad or m], None where the rows' order shows none."""
    simulation = samples.simulation
    if len(part.rows) < _LEAST or (simulation is not None and not simulation.hidden):
        return None  # nothing that rows could show
    rows = part.rows[:: -(-len(part.rows) // _ROWS)]
    scale = part.smooth.scale
    u = scale.to_unit(samples.q[rows])
    value, slope = part.smooth.value_and_slope(u)
    side = directions(samples.q)[rows]
    # a joint near a limit mostly came from one side: its curve has taken that part already
    surprise = np.empty_like(side)
    for k, v in enumerate(u.T):
        powers = np.polynomial.chebyshev.chebvander(
            2.0 * np.clip(v, 0.0, 1.0) - 1.0, _TREND
        )
        surprise[:, k] = (
            side[:, k] - powers @ np.linalg.lstsq(powers, side[:, k], rcond=None)[0]
        )
    return learn_play(samples.x[rows] - value, slope / scale.span, surprise)


def play_words(samples: Samples, play: Array) -> str:
    """One line about the backlash that the order of the rows shows."""
    backlash = [
        f"{name} {np.degrees(2 * h):.3g} deg" if turns else f"{name} {2 * h:.3g} m"
        for name, h, turns in zip(
            samples.joint_names, play, samples.revolute, strict=True
        )
        if h > 0.0
    ]
    return (
        f"the direction of approach counts, backlash of {', '.join(backlash)}: give it to forward "
        "for smaller errors, else the expected error covers both sides"
    )
