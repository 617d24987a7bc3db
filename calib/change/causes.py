"""Causes: what changed between a model and a log, in numbers and in words.

`check` and `adapt` ask here with the same comparison, so that both say the same of one log.
What a log cannot tell apart is said with the cause that was named: a sensor that was turned about
the first joint's axis and that joint's offset are the same; so are a sensor that shows all larger
and links that are all longer.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..common.wording import for_people
from ..model.alignment import Alignment
from ..samples.plausibility import unit_hint
from .cause import Cause
from .group_tests import fired
from .members import CREEP, FRAME, NOTHING
from .parameter_causes import SIGNIFICANT, of_parameters, single
from .whitening import scaled

if TYPE_CHECKING:
    from .comparison import Comparison

_NOISIER = 1.5  # noise over the usual one from which it is worth a word

_ALIKE = 0.15  # share of a displacement that may differ between two words for it


def find_causes(comparison: Comparison, drifted: bool) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Causes of a log, and what else must be said of them.

    drifted : whether something fired; otherwise more noise is the only cause there may be
    Returns causes : the largest first
    Returns notes : directions that the log cannot tell apart
    """
    found: list[Cause] = []
    notes: list[str] = []
    if drifted and not comparison.explained:
        found.append(Cause("unknown", "", None, None, "", comparison.why_not()))
    elif drifted:
        found += _of_frame(comparison)
        best = comparison.explanations[0]
        if comparison.changed and best.member != NOTHING:
            found += of_parameters(comparison, best)
        elif comparison.changed and best.waves > CREEP:
            words = "the joints have waves that the model does not know: gears, or their sensors"
            found.append(Cause("curve", "curve", None, None, "", words))
        elif not found:
            found += _of_tests(comparison)
        more, notes = same_as_first_joint(comparison, found)
        scaled, unsettled = same_as_scale(comparison, found)
        found += [*more, *scaled]
        notes += unsettled
        if not found:
            words = "no single change of the sensor, a joint or a link explains it"
            found.append(Cause("unknown", "", None, None, "", words))
    found += _noise(comparison, drifted)
    return tuple(found), tuple(notes)


def _of_frame(comparison: Comparison) -> list[Cause]:
    """What had to be found before anything else: mirrors, senses, units."""
    reference, names = comparison.reference, comparison.model.about.joint_names
    found = []
    if reference.mirrored:
        words = "the log's positions are mirrored, compared with the model"
        old = comparison.body.predict(comparison.probes)
        new = reference.structure.predict(comparison.probes, reference.beta)
        if old.shape[1] == 2 and Alignment.between(old, new).swapped:
            words = "x and y of the log are exchanged, compared with the model"
        found.append(Cause("mirror", "view.mirror", None, None, "", words))
    for k in reference.turned:
        words = f"{names[k]} turns the other way than before"
        found.append(Cause(f"sign:{names[k]}", "sign", None, None, "", words))
    for k in reference.locked:
        words = f"{names[k]} no longer moves the tip"
        found.append(Cause(f"lost:{names[k]}", "gain", 0.0, None, "1", words))
    if reference.scale != 1.0:
        ratio = reference.scale
        words = f"the log's positions are {ratio:.4g} times the model's{unit_hint(ratio)}"
        found.append(Cause("scale", "view.scale", ratio, None, "1", words))
    return found


def _of_tests(comparison: Comparison) -> list[Cause]:
    """The most telling group that fired, where no member is clearly better than no change."""
    structure, above = comparison.body.structure, fired(comparison.tested.groups)
    if not above:
        return []
    best = above[0]
    if best.name.startswith("sensor") or best.name == "lens":
        value, half = float(best.estimate[0]), 1.96 * float(best.deviation[0])
        label = structure.label(int(best.indices[0]))
        words = "the sensor's frame moved a little"
        if label.unit == "rad":
            words = f"the sensor turned by {math.degrees(value):.3g} ± {math.degrees(half):.2g} deg"
        return [
            Cause("sensor", label.group, value, (value - half, value + half), label.unit, words)
        ]
    found = []
    for index, value, sd in zip(best.indices, best.estimate, best.deviation, strict=True):
        label = structure.label(int(index))
        own = label.joint is not None and abs(value) > SIGNIFICANT * sd
        if own and label.group in ("offset", "length", "gain", "placement"):
            found.append(single(label, comparison.body.beta[index], value, sd))
    return found


def _noise(comparison: Comparison, drifted: bool) -> list[Cause]:
    tested = comparison.tested
    if drifted and not comparison.explained:
        return []
    noise = tested.noise
    if drifted and comparison.changed:  # a large change is not linear: what the best one leaves
        size = float(scaled(comparison.belief).size[0])
        noise = min(noise, comparison.explanations[0].noise * size)
    if noise < _NOISIER * tested.usual:
        return []
    factor, unit = for_people(comparison.unit_seen)
    usual = f"{noise / tested.usual:.2g} times the usual"
    words = f"the scatter is {factor * noise:.3g} {unit} per axis, {usual}"
    return [Cause("noise", "noise", float(noise), None, comparison.unit_seen, words)]


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
    moved[offset[0]] += sense * sensor.value
    best = comparison.explanations[0].beta if comparison.changed else body.beta
    framed = body.beta.copy()
    for group in FRAME:
        framed[structure.groups[group]] = best[structure.groups[group]]
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
    if any(c.cause == "scale" and c.interval is not None for c in found):
        return [], told
    longer = {c.cause: c for c in found if c.group == "length"}
    if len(longer) < len(about.joint_names):
        return [], []
    ratios = []
    for name, index in zip(about.joint_names, lengths, strict=True):
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
