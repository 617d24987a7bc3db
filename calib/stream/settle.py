"""Settling: a model of maps that followed a stream, with the links and local models of its rows."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..body.body_fit import fit
from ..body.rows import Rows as Measured
from ..common.arrays import Array
from ..errors import CalibError
from ..maps.association import Association
from ..maps.links import SparseRows
from ..maps.local_models import NO_MODELS
from ..maps.map import Map
from ..maps.model_selection import blocks, select
from ..maps.predictor import BodyInBox
from ..model.about import MeasuredRows
from ..model.model import Model
from ..training.bounds import node_bounds


@dataclass(frozen=True)
class SettleSettings:
    """What a settled model rests on."""

    # samples that links are learned from where the stream is short
    imagined: int = 20_000
    # that a body is refitted to: more would tell it hardly more
    rows: int = 3000
    # fewer have no links of their own
    few_rows: int = 1000


SETTLED = SettleSettings()


def settled_model(
    model: Model,
    motor: Map,
    sensory: Map,
    q: Array,
    x: Array,
    links: SparseRows | None = None,
) -> Model:
    """A model with maps as they are now, which have followed some samples.

    q, x : (n, dof), (n, m) [unit], samples since the change
    links : (motor, sensory), links as they are; by default those at which eq. 11 comes to rest for
        the samples.
    """
    scale = motor.scale
    wiring = model.association.wiring
    body = model.body
    body_fit = None
    # a short stream may have been shown again and again
    first = np.sort(np.unique(np.hstack([q, x]), axis=0, return_index=True)[1])
    u = scale.to_unit(q[first])
    x = x[first]
    some = slice(None, None, -(-len(u) // SETTLED.rows))
    if body is not None:
        with suppress(CalibError):  # too few rows, or too close to each other
            measured = [Measured(scale.from_unit(u[some]), x[some])]
            body_fit = fit(body.structure, measured, seed=model.about.seed)

    def link(u: Array, x: Array) -> Association:
        return Association.learn(
            motor, u, sensory, sensory.scale.to_unit(x), wiring
        )

    samples = (u, x)
    predictor = None
    if body_fit is not None:
        smooth = BodyInBox(body_fit.body, scale)
        predictor, remaining = select(
            motor, u[some], x[some], smooth, body_fit.held_out
        )
        rows = np.arange(len(u))[some]
        errors = np.linalg.norm(remaining, axis=1)
        if len(u) < SETTLED.few_rows:
            drawn = np.random.default_rng(model.about.seed).random(
                (SETTLED.imagined, u.shape[1])
            )
            samples = drawn, predictor.value(drawn)
    association = (
        link(*samples)
        if links is None
        else Association(motor, sensory, links, wiring)
    )
    if (
        predictor is None
    ):  # maps and links alone, their errors from every other block
        folds = blocks(len(u))
        rows = np.arange(len(u))
        errors = np.empty(len(u))
        for half in (0, 1):
            held_out_rows, shown = (
                np.concatenate(folds[k::2]) for k in (half, 1 - half)
            )
            away = (
                link(u[shown], x[shown]).linear.value(u[held_out_rows])
                - x[held_out_rows]
            )
            errors[held_out_rows] = np.linalg.norm(away, axis=1)
    made = replace(
        model,
        association=association,
        local=NO_MODELS if predictor is None else predictor.models,
        body=None if body_fit is None else body_fit.body,
        visited=np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size)
        > 0,
        rows=MeasuredRows.of(scale.from_unit(u), x)
        if model.rows is not None
        else None,
    )
    reading, position = node_bounds(made, u[rows], errors)
    true = model.about.bound_of == "true position"
    return replace(
        made, bounds=position if true else reading, model_bounds=position
    )
