"""Sensors: one arm in the models of all the sensors that saw it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.belief import Body
from .parts import Parts


def with_arm_of(parts: Parts, adapted: Parts) -> Parts:
    """Return one sensor's parts with the arm of another one's adapted model.

    The parts of the sensor that was adapted are the adapted model's.
    """
    own = replace(adapted, others=())
    if parts.about.sensor == adapted.about.sensor:
        return own
    alone = replace(parts, others=())
    if (
        parts.body is None
        or adapted.body is None
        or not _same_layout(parts.body, adapted.body)
    ):
        return alone
    body = replace(
        parts.body,
        beta=adapted.body.beta,
        active=adapted.body.active,
        root=adapted.body.root,
        scales=adapted.body.scales,
        second=None,
    )
    if adapted.body.second is not None:
        noise = (
            parts.body.noise if parts.body.second is None else parts.body.second.noise
        )
        body = replace(body, second=replace(adapted.body.second, noise=noise))
    nodes = parts.motor.scale.from_unit(np.clip(parts.motor.units, 0.0, 1.0))
    return replace(
        alone,
        body=body,
        bounds=np.maximum(parts.bounds, body.bound(nodes)),
        model_bounds=np.maximum(parts.model_bounds, body.bound(nodes, noise=False)),
        history=adapted.history,
        approach=adapted.approach,
    )


def _same_layout(body: Body, other: Body) -> bool:
    """Whether two bodies have the same parameters in the same order."""
    names = [label.name for label in body.structure.labels]
    return names == [label.name for label in other.structure.labels]
