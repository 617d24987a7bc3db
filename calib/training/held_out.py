"""Held out: errors of a log's model on blocks of rows that it has not seen, and its bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..body.covariance import RADIUS_95
from ..common.arrays import Array
from ..common.choices import MAP_READOUTS
from ..maps.model_selection import Selected
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..samples.samples import Samples
from .evaluate import Residuals
from .learn import associate
from .options import TrainingOptions
from .smooth import SmoothPart, to_learn

_TESTED = 5_000  # rows that errors are measured on; more would tell no more
_HALVES = 2  # the maps' readouts are tested on blocks that the other half did not show


def held_out_residuals(
    model: Model,
    samples: Samples,
    part: SmoothPart | None,
    selected: Selected | None,
    options: TrainingOptions,
) -> Residuals:
    """Residuals of all readouts on rows that were held out in contiguous blocks.

    The default readout and the body are held out in ten blocks; the readouts of the maps
    are those of maps that have learned from every other block.
    """
    forward: dict[str, Array] = {}
    rows = np.arange(len(samples)) if part is None else part.rows
    rows = rows[:: max(1, len(rows) // _TESTED)]
    if part is not None and selected is not None:
        rows = part.rows[selected.rows]
        forward["local"] = -selected.residual
        if "body" in model.readouts:
            forward["body"] = -part.fit.held_out[selected.rows]
    q, x = samples.q[rows], samples.x[rows]
    scale, predict, clip = model.motor.scale, model.predictor.value, model.solver.clip
    u = scale.to_unit(q)
    here, near = predict(u), clip(u)
    inverse = {r: np.empty_like(q) for r in (*forward, *MAP_READOUTS)}
    distance = {r: np.empty(len(q)) for r in inverse}

    def judge(readout: str, rows: NDArray[np.intp], answer: Array) -> None:
        """Note by how much answers miss the joints, and where the learned map leads from them."""
        inverse[readout][rows] = scale.difference(answer, u[rows]) * scale.span
        distance[readout][rows] = np.linalg.norm(predict(answer) - here[rows], axis=1)

    for readout, error in list(forward.items()):
        # a target that a held-out prediction misses is answered by joints that the map leads there
        answer = model.solve(here - error, scale.from_unit(near))
        judge(readout, np.arange(len(q)), scale.to_unit(answer.q))
    forward |= {r: np.empty_like(x) for r in MAP_READOUTS}
    folds = np.array_split(np.arange(len(samples)), 2 * _HALVES * 5)
    for half in range(_HALVES):
        unseen = np.concatenate(folds[half::_HALVES])
        chosen = np.flatnonzero(np.isin(rows, unseen))
        if not len(chosen):
            continue
        seen = np.setdiff1d(np.arange(len(samples)), unseen, assume_unique=True)
        seen_u, seen_x, wrong = to_learn(samples, scale, part, options, seen)
        pair = associate(scale, seen_u, seen_x, options, wrong)
        box = pair.sensory.scale
        answers = pair.inverses(box.to_unit(x[chosen]), near[chosen], MAP_READOUTS)
        for readout in MAP_READOUTS:
            predicted = box.from_unit(pair.forward(u[chosen], readout))
            forward[readout][chosen] = predicted - x[chosen]
            judge(readout, chosen, clip(answers[readout]))
    return Residuals(q, x, forward, inverse, distance, samples.joint_names, 0)


def turned_of(part: SmoothPart | None) -> Array | None:
    """Held-out errors of orientation (k,) [rad] of those rows, None where it was not measured."""
    if part is None or part.fit.turned is None:
        return None
    return part.fit.turned[:: max(1, len(part.rows) // _TESTED)]


def node_bounds(
    model: Model, u: Array, rows: NDArray[np.intp], errors: Array
) -> tuple[Array, Array]:
    """Bounds (nodes,) of a log's model on what the sensor reads and on the true position.

    With a body they are its posterior's: they grow with the distance from the rows by themselves.
    Without one they are learned from `rows` (k,) of `u` (n, dof), held out with `errors` (k,)
    [unit], and grow beyond the rows as fast as the position can change.
    """
    motor = model.motor
    nodes = np.clip(motor.units, 0.0, 1.0)
    if model.body is None:
        learned = learn_bounds(motor, u[rows], errors)
        return learned, learned  # they hold beside the rows, see `calib.model.trust`
    q = motor.scale.from_unit(nodes)
    reading = model.body.bound(q, noise=True)
    position = model.body.bound(q, noise=False)
    if model.predictor.models.degree >= 0:
        # where held-out rows are further off than the body says, as in a local defect
        learned = learn_bounds(motor, u[rows], errors)
        noise = RADIUS_95 * float(np.sqrt(np.mean(model.body.noise[:2] ** 2)))
        own = np.sqrt(np.maximum(learned**2 - noise**2, 0.0))
        position = np.where(learned > reading, np.maximum(position, own), position)
        reading = np.maximum(reading, learned)
    return reading, position
