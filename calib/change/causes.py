"""Causes: what changed between a model and a log, in numbers and in words.

`check` and `adapt` ask here with the same comparison, so that both say the same of one log.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..body.structure import Array, Indices
from .alignment import Alignment
from .members import FRAME

if TYPE_CHECKING:
    from .comparison import Comparison
    from .explain import Explanation

_SIGNIFICANT = 2.6  # standard deviations from which a parameter is said to have changed
_MATTERS = 0.05  # share of the largest displacement from which a cause is named
_ALIKE = 0.15  # share of a displacement that may differ between two words for it
_NOISIER = 1.5  # noise over the usual one from which it is worth a word
_WORDS = {
    "view.scale": "the sensor's scale changed",
    "view.shear": "the sensor's axes are stretched or sheared",
    "view.tilt": "the camera is tilted",
    "lens": "the sensor's frame is bent, as by a lens",
}


@dataclass(frozen=True)
class Cause:
    """One change that explains a log.

    Attributes
    ----------
    cause : str
        ``"sensor"``, ``"offset:JOINT"``, ``"length:JOINT"``, ``"gain:JOINT"``,
        ``"elastic:JOINT"``, ``"curve:JOINT"``, ``"scale"``, ``"tilt"``, ``"lens"``,
        ``"mirror"``, ``"sign:JOINT"``, ``"lost:JOINT"``, ``"noise"`` or ``"unknown"``.
    group : str
        Group of parameters: ``"view.rotation"``, ``"offset"``, ``"length"``, ...
    value : float or None
        Size of the change, None where no number tells it.
    interval : (float, float) or None
        95 % interval of the value.
    unit : str
        Unit of the value.
    words : str
        The same in words.
    """

    cause: str
    group: str
    value: float | None
    interval: tuple[float, float] | None
    unit: str
    words: str

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "cause": self.cause,
            "group": self.group,
            "value": self.value,
            "interval": None if self.interval is None else list(self.interval),
            "unit": self.unit,
            "words": self.words,
        }


def find_causes(comparison: Comparison, drifted: bool) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Causes of a log, and what else must be said of them.

    Parameters
    ----------
    comparison : Comparison
    drifted : bool
        Whether something fired; otherwise more noise is the only cause there may be.

    Returns
    -------
    causes : tuple of Cause
        The largest first.
    notes : tuple of str
        Directions that the log cannot tell apart.
    """
    found: list[Cause] = []
    notes: list[str] = []
    if drifted and not comparison.explained:
        found.append(Cause("unknown", "", None, None, "", comparison.why_not()))
    elif drifted:
        found += _of_frame(comparison)
        best = comparison.explanations[0]
        if comparison.changed:
            found += _of_parameters(comparison, best)
        elif not found:
            found += _of_tests(comparison)
        more, notes = _same_as_first_joint(comparison, found)
        found += more
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
        if abs(ratio / 1e3 - 1.0) < 0.1:
            words += "; if they are mm, `unit='mm'` converts them"
        found.append(Cause("scale", "view.scale", ratio, None, "1", words))
    return found


def _swapped(comparison: Comparison) -> bool:
    reference = comparison.reference
    old = comparison.body.structure.predict(comparison.probes, comparison.body.beta)
    new = reference.structure.predict(comparison.probes, reference.beta)
    return old.shape[1] == 2 and Alignment.between(old, new).swapped


def _of_parameters(comparison: Comparison, best: Explanation) -> list[Cause]:
    """Each freed parameter that is significantly away from where it was."""
    structure, old = comparison.reference.structure, comparison.belief.beta
    found: list[tuple[float, Cause]] = []
    every = np.flatnonzero(best.sd > 0)
    _, moves = structure.linearise(comparison.probes, best.beta, every)
    size = np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    for group in best.member.groups:
        if group in FRAME or (group == "view.scale" and comparison.reference.scale != 1.0):
            continue
        for name, ix in structure.groups.items():
            if name != group and not (group == "curve" and name.startswith("curve.")):
                continue
            found += _of_group(comparison, best, name, np.asarray(ix), old, every, size)
    if best.member.framed:
        found += _of_sensor(comparison, best, old, every, size)
    if not comparison.reference.locked:
        found += _lost(comparison, best, old)
    found.sort(key=lambda pair: -pair[0])
    finite = [moved for moved, _ in found if math.isfinite(moved)]
    least = _MATTERS * max(finite, default=0.0)
    return [cause for moved, cause in found if moved >= least]


def _of_group(
    comparison: Comparison,
    best: Explanation,
    group: str,
    ix: Indices,
    old: Array,
    every: Indices,
    size: Array,
) -> list[tuple[float, Cause]]:
    """Causes of one group with the displacement that each makes."""
    structure = comparison.reference.structure
    change, deviation = (best.beta - old)[ix], best.deviation[ix]
    clear = (deviation > 0) & (np.abs(change) > _SIGNIFICANT * deviation)
    if group.startswith("curve") or group in _WORDS or group == "elastic":
        if not clear.any():
            return []
        moved = float(np.linalg.norm(change * size[np.searchsorted(every, ix)]))
        largest = int(np.argmax(np.abs(change) * clear))
        return [(moved, _summed(structure, group, int(ix[largest]), change, deviation, largest))]
    found = []
    for k in np.flatnonzero(clear):
        label = structure.label(int(ix[k]))
        moved = abs(float(change[k])) * float(size[np.searchsorted(every, ix[k])])
        found.append((moved, _single(label, old[ix[k]], change[k], deviation[k])))
    return found


def _summed(
    structure: Any, group: str, index: int, change: Array, deviation: Array, largest: int
) -> Cause:
    label = structure.label(index)
    value, half = float(change[largest]), 1.96 * float(deviation[largest])
    if group in _WORDS:
        name = group.removeprefix("view.")
        words = _WORDS[group]
        if group == "view.scale":
            words += f" by {100 * math.expm1(value):+.3g} %"
        return Cause(name, group, value, (value - half, value + half), label.unit, words)
    name = f"{'curve' if group.startswith('curve') else group}:{label.joint}"
    what = "gives way under load" if group == "elastic" else "follows another curve"
    size = math.degrees(float(np.abs(change).max()))
    words = f"{label.joint} {what}, by up to {size:.3g} deg"
    return Cause(name, group, value, (value - half, value + half), label.unit, words)


def _single(label: Any, old: float, change: float, sd: float) -> Cause:
    """A cause that one number tells."""
    value, half = float(change), 1.96 * float(sd)
    joint = label.joint or ""
    name = f"{label.group}:{joint}" if joint else label.group
    unit = label.unit
    if label.unit == "rad":
        words = f"{joint} is off by {math.degrees(value):+.3g} ± {math.degrees(half):.2g} deg"
    elif label.group == "length":
        share = 100 * abs(value / old) if old else float("nan")
        size = f"{share:.3g} %"
        if unit == "m":
            size += f" ({1e3 * abs(value):.3g} ± {1e3 * half:.2g} mm)"
        words = f"the link of {joint} is {size} {'longer' if value > 0 else 'shorter'}"
    elif label.group == "gain":
        words = f"{joint} moves {100 * value:+.3g} ± {100 * half:.2g} % further than it says"
    else:
        words = f"{label.name} changed by {value:.4g} ± {half:.2g} {unit}"
    return Cause(name, label.group, value, (value - half, value + half), unit, words)


def _of_sensor(
    comparison: Comparison, best: Explanation, old: Array, every: Indices, size: Array
) -> list[tuple[float, Cause]]:
    """The sensor's frame as one cause, its rotation as the number."""
    structure = comparison.reference.structure
    turn, shift = (np.asarray(structure.groups[g]) for g in FRAME)
    both = np.concatenate([turn, shift])
    change, deviation = (best.beta - old)[both], best.deviation[both]
    mirrored = comparison.reference.mirrored
    new = mirrored or comparison.reference.scale != 1.0
    if not new and not (np.abs(change) > _SIGNIFICANT * deviation).any():
        return []
    frame = frame_between(comparison, best.beta)
    value, half = float(change[0]), 1.96 * float(deviation[0])
    value = (value + math.pi) % (2 * math.pi) - math.pi
    said = f"turned {math.degrees(value):.3g} ± {math.degrees(half):.2g} deg"
    if frame is not None:
        said = frame.words(comparison.unit)
    words = f"the sensor's frame moved: {said}"
    where = np.searchsorted(every, both)
    moved = math.inf if new else float(np.linalg.norm(change * size[where]))
    cause = Cause("sensor", "view.rotation", value, (value - half, value + half), "rad", words)
    return [(moved, cause)]


def frame_between(comparison: Comparison, beta: Array) -> Alignment | None:
    """The sensor's new frame as an affine map of the old one; None in space."""
    structure, old = comparison.reference.structure, comparison.body
    seen = old.structure.predict(comparison.probes, old.beta)
    if seen.shape[1] != 2:
        return None
    mixed = comparison.belief.beta.copy()
    for name, ix in structure.groups.items():
        if name.startswith("view.") or name == "lens":
            mixed[np.asarray(ix)] = beta[np.asarray(ix)]
    return Alignment.between(seen, structure.predict(comparison.probes, mixed))


def _lost(comparison: Comparison, best: Explanation, old: Array) -> list[tuple[float, Cause]]:
    """Joints that moved the tip and no longer do."""
    structure, names = comparison.reference.structure, comparison.model.about.joint_names
    before = np.sqrt((structure.slope(comparison.probes, old) ** 2).sum(axis=1).mean(axis=0))
    after = np.sqrt((structure.slope(comparison.probes, best.beta) ** 2).sum(axis=1).mean(axis=0))
    scale = float(np.sum(after) / max(float(np.sum(before)), 1e-300))
    found = []
    for k, name in enumerate(names):
        if after[k] < 0.02 * before[k] * min(scale, 1.0):
            words = f"{name} no longer moves the tip"
            found.append((math.inf, Cause(f"lost:{name}", "gain", 0.0, None, "1", words)))
    return found


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
        own = label.joint is not None and abs(value) > _SIGNIFICANT * sd
        if own and label.group in ("offset", "length", "gain", "placement"):
            found.append(_single(label, comparison.body.beta[index], value, sd))
    return found


def _same_as_first_joint(
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
        "this log: give cause='joints' or cause='sensor' if you know which"
    )
    if f"offset:{first}" in names:
        angle = next(c for c in found if c.cause == f"offset:{first}")
        same = Cause(
            "sensor", "view.rotation", angle.value, angle.interval, "rad",
            f"or the sensor turned by {math.degrees(angle.value or 0.0):.3g} deg about {first}",
        )  # fmt: skip
        return ([same] if "sensor" not in names else []), [words]
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
    return [same], [words]


def _noise(comparison: Comparison, drifted: bool) -> list[Cause]:
    tested = comparison.tested
    if (drifted and not comparison.explained) or tested.noise < _NOISIER * tested.usual:
        return []
    factor, unit = (1e3, "mm") if comparison.unit == "m" else (1.0, comparison.unit)
    words = f"the scatter is {factor * tested.noise:.3g} {unit} per axis"
    words += f", {tested.noise / tested.usual:.2g} times the usual"
    return [Cause("noise", "noise", tested.noise, None, comparison.unit, words)]
