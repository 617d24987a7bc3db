"""Directions that a log cannot tell apart, said with the cause that was named.

A sensor that was turned about the first joint's axis and that joint's offset are the same; so
are a sensor that shows all larger and links that are all longer.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from .cause import Cause
from .members import FRAME

if TYPE_CHECKING:
    from .comparison import Comparison

_ALIKE = 0.15  # share of a displacement that may differ between two words for it


def same_as_first_joint(
    comparison: Comparison, found: list[Cause]
) -> tuple[list[Cause], list[str]]:
    """The first joint's offset where a moved sensor says the same, and the other way round."""
    about = comparison.model.about
    first = about.joint_names[0]
    names = {c.cause for c in found}
    structure = comparison.body.structure
    offset = structure.groups.get("offset")
    if offset is None or not about.revolute[0] or "mirror" in names:
        return [], []
    words = (
        "an offset of the first joint and a turn of the sensor about its axis are the same to "
        "this log: give `cause='joints'` or `cause='sensor'` if you know which"
    )
    told = [words] if comparison.cause is None else []
    if f"offset:{first}" in names:
        angle = next(c for c in found if c.cause == f"offset:{first}")
        same = Cause(
            "sensor", "view.rotation", angle.value, angle.interval, "rad",
            f"or the sensor turned by {math.degrees(angle.value or 0.0):.3g} deg about {first}",
        )  # fmt: skip
        return ([same] if "sensor" not in names else []), told
    sensor = next((c for c in found if c.cause == "sensor" and c.unit == "rad"), None)
    if sensor is None or sensor.value is None or sensor.interval is None:
        return [], []
    body = comparison.body
    seen = structure.predict(comparison.probes, body.beta)
    moved = body.beta.copy()
    sense = int(getattr(structure, "mirror", 1))
    moved[int(np.asarray(offset)[0])] += sense * sensor.value
    best = comparison.explanations[0].beta if comparison.changed else body.beta
    framed = body.beta.copy()
    for group in FRAME:
        ix = np.asarray(structure.groups[group])
        framed[ix] = best[ix]
    change = structure.predict(comparison.probes, framed) - seen
    gap = change - (structure.predict(comparison.probes, moved) - seen)
    if np.linalg.norm(gap) > _ALIKE * np.linalg.norm(change) + 1e-12:
        return [], []
    value, (low, high) = sense * sensor.value, sensor.interval
    low, high = sorted((sense * low, sense * high))
    same = Cause(
        f"offset:{first}", "offset", value, (low, high), "rad",
        f"or {first} is off by {math.degrees(value):.3g} deg",
    )  # fmt: skip
    return [same], told


def same_as_scale(comparison: Comparison, found: list[Cause]) -> tuple[list[Cause], list[str]]:
    """A sensor's scale where all links say the same, and the other way round."""
    about, body = comparison.model.about, comparison.belief
    lengths = body.structure.groups.get("length")
    if lengths is None or not all(about.revolute) or len(lengths) != len(about.joint_names):
        return [], []
    words = (
        "a sensor that shows all larger and links that are all longer are the same to this log: "
        "give `cause='joints'` or `cause='sensor'` if you know which"
    )
    told = [words] if comparison.cause is None else []
    scale = next((c for c in found if c.cause == "scale" and c.interval is not None), None)
    if scale is not None:
        return [], told
    longer = {c.cause: c for c in found if c.group == "length"}
    if len(longer) < len(about.joint_names):
        return [], []
    ratios = []
    for name, index in zip(about.joint_names, np.asarray(lengths), strict=True):
        value, interval = longer[f"length:{name}"].value, longer[f"length:{name}"].interval
        if value is None or interval is None:
            return [], []
        length = float(body.beta[index])
        ratios.append((interval[0] / length, value / length, interval[1] / length))
    low, high = max(r[0] for r in ratios), min(r[2] for r in ratios)
    if low > high:
        return [], []
    value = float(np.mean([r[1] for r in ratios]))
    same = Cause(
        "scale", "view.scale", math.log1p(value), (math.log1p(low), math.log1p(high)), "1",
        f"or the sensor shows all {100 * abs(value):.3g} % {'larger' if value > 0 else 'smaller'}",
    )  # fmt: skip
    return [same], told
