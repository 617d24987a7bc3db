"""Causes: what changed between a model and a log, in numbers and in words.

`check` and `adapt` ask here with the same comparison, so that both say the same of one log.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..common.wording import for_people
from ..model.alignment import Alignment
from ..samples.plausibility import unit_hint
from .alike import same_as_first_joint, same_as_scale
from .cause import Cause
from .members import CREEP, NOTHING
from .parameter_causes import SIGNIFICANT, of_parameters, single
from .whitening import scaled

if TYPE_CHECKING:
    from .comparison import Comparison

_NOISIER = 1.5  # noise over the usual one from which it is worth a word


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
        if _swapped(comparison):
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
        words = f"the log's positions are {ratio:.4g} times the model's"
        words += unit_hint(ratio)
        found.append(Cause("scale", "view.scale", ratio, None, "1", words))
    return found


def _swapped(comparison: Comparison) -> bool:
    reference = comparison.reference
    old = comparison.body.structure.predict(comparison.probes, comparison.body.beta)
    new = reference.structure.predict(comparison.probes, reference.beta)
    return old.shape[1] == 2 and Alignment.between(old, new).swapped


def _of_tests(comparison: Comparison) -> list[Cause]:
    """The most telling group that fired, where no member is clearly better than no change."""
    structure, fired = comparison.body.structure, comparison.tested.fired
    if not fired:
        return []
    best = fired[0]
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
    words = f"the scatter is {factor * noise:.3g} {unit} per axis"
    words += f", {noise / tested.usual:.2g} times the usual"
    return [Cause("noise", "noise", float(noise), None, comparison.unit_seen, words)]
