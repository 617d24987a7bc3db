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
    if parts.about.sensor == adapted.about.sensor:
        return replace(adapted, others=())
    alone = replace(parts, others=())
    before = parts.body
    after = adapted.body
    if before is None or after is None or not _same_layout(before, after):
        return alone
    second = after.second
    if second is not None:
        noise = before.noise if before.second is None else before.second.noise
        second = replace(second, noise=noise)
    body = replace(
        before,
        beta=after.beta,
        active=after.active,
        root=after.root,
        scales=after.scales,
        second=second,
    )
    nodes = parts.motor.scale.from_unit(np.clip(parts.motor.units, 0.0, 1.0))
    return replace(
        alone,
        body=body,
        bounds=np.maximum(parts.bounds, body.bound(nodes)),
        model_bounds=np.maximum(
            parts.model_bounds, body.bound(nodes, noise=False)
        ),
        history=adapted.history,
        approach=adapted.approach,
    )


def _same_layout(body: Body, other: Body) -> bool:
    """Whether two bodies have the same parameters in the same order."""
    names = [label.name for label in body.structure.labels]
    return names == [label.name for label in other.structure.labels]
