"""The direction of approach in training: joints corrected by their backlash where it pays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.approach import Approach, learn_play
from ..common.arrays import Array
from ..common.scale import Scale
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..samples.joint_values import directions
from ..samples.samples import Samples
from ..samples.simulation import Simulation
from .smooth import SmoothPart

BOUND_SAMPLES = 12_000
"""Exact samples that bounds are learned from."""

_ROWS = 5_000  # rows that play is learned from
_TREND = 7  # degree of what a joint's value tells of its direction


def play_of(samples: Samples, scale: Scale, part: SmoothPart) -> Array | None:
    """Half the play of each joint (dof,) [rad or m], None where the rows' order shows none."""
    if samples.simulation is not None and not samples.simulation.hidden:
        return None  # nothing that rows could show
    few = max(1, -(-len(part.rows) // _ROWS))
    rows = part.rows[::few]
    smooth, u = part.smooth, scale.to_unit(samples.q[rows])
    value, slope = smooth.value_and_slope(u)
    residual = samples.x[rows] - value
    size = np.linalg.norm(residual, axis=1)
    sound = size <= 10.0 * np.median(size) + 1e-300  # a few wrong detections do not count
    if np.count_nonzero(sound) < 20:
        return None
    side = directions(samples.q)[rows]
    # a joint near its upper limit mostly came from below: a curve of the joint has taken
    # that part of the play already
    surprise = np.empty_like(side)
    for k, v in enumerate(u.T):
        powers = np.polynomial.chebyshev.chebvander(2.0 * np.clip(v, 0.0, 1.0) - 1.0, _TREND)
        trend = np.linalg.lstsq(powers, side[:, k], rcond=None)[0]
        surprise[:, k] = side[:, k] - powers @ trend
    return learn_play(residual[sound], (slope / scale.span)[sound], surprise[sound])


def approached(
    model: Model, simulation: Simulation | None, play: Array, seed: np.random.SeedSequence
) -> Model:
    """The model with bounds for a known direction of approach, and for an unknown one."""
    scale = model.motor.scale
    if simulation is not None:  # true positions tell what is bounded where the direction is known
        rng = np.random.default_rng(seed)
        q = simulation.draw(BOUND_SAMPLES, rng)
        x, side = simulation.true(q, rng), directions(q)
        approach = Approach(play, model.bounds)
        rows = approach.known(side)
        u = scale.to_unit(approach.effective(q, side)[rows])
        errors = np.linalg.norm(model.predictor.value(u) - x[rows], axis=1)
        inside = model.trust.in_range(u).all(axis=1)
        learned = learn_bounds(model.motor, u[inside], errors[inside])
        return replace(model, approach=Approach(play, learned))
    nodes = np.clip(model.motor.units, 0.0, 1.0)
    slope = model.predictor.value_and_slope(nodes)[1] / scale.span
    most = np.linalg.norm(slope * play, axis=1).sum(axis=1)  # all joints to their worst side
    return replace(
        model,
        bounds=model.bounds + most,
        model_bounds=model.model_bounds + most,
        approach=Approach(play, model.bounds),
    )


def play_words(samples: Samples, play: Array) -> str:
    """One line about the backlash that the order of the rows shows."""
    backlash = [
        f"{name} {np.degrees(2 * h):.3g} deg" if turns else f"{name} {2 * h:.3g} m"
        for name, h, turns in zip(samples.joint_names, play, samples.revolute, strict=True)
        if h > 0.0
    ]
    return (
        f"the direction of approach counts, backlash of {', '.join(backlash)}: give it to forward "
        "for smaller errors, else the expected error covers both sides"
    )
