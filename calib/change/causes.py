"""Causes: what changed between a model and a log, in numbers and in words.

What a log cannot tell apart is said with the cause that was named: a sensor that was turned about
the first joint's axis and that joint's offset; a sensor that shows all larger and longer links.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.wording import for_people
from ..model.alignment import Alignment
from ..samples.diagnosis import unit_hint
from .comparison import Comparison
from .explain import simplest
from .hypotheses import FRAME, GROUPS, OFF, indices_of, is_sensors, parts_of
from .score import fired
from .settings import CREEP

_SIGNIFICANT = 2.6  # standard deviations from which a parameter is said to have changed
_NOISIER = 1.5  # noise over the usual one from which it is worth a word
_ALIKE = 0.15  # share of a displacement that may differ between two words for it
_VAGUE = math.radians(1.0)  # half an interval of a turn from which it is worth a word
_MATTERS = 0.05  # share of the largest displacement from which a cause is named
_WHICH = "are the same to this log: give `cause='joints'` or `cause='sensor'` if you know which"


@dataclass(frozen=True)
class Cause:
    """One change that explains a log."""

    # ``"sensor"``, ``"offset:JOINT"``, ``"length:JOINT"``, ``"gain:JOINT"``, ``"elastic:JOINT"``,
    # ``"curve:JOINT"``, ``"curve"`` of all joints, ``"scale"``, ``"tilt"``, ``"lens"``,
    # ``"mirror"``, ``"sign:JOINT"``, ``"lost:JOINT"``, ``"noise"`` or ``"unknown"``
    cause: str
    group: str  # group of parameters: ``"view.rotation"``, ``"offset"``, ``"length"``,
    words: str  # the same in words
    value: float | None = None  # size of the change, None where no number tells it
    interval: tuple[float, float] | None = None  # 95 % interval of the value
    unit: str = ""  # unit of the value

    @staticmethod
    def measured(name: str, group: str, words: str, value: float, half: float, unit: str) -> Cause:
        """A cause with half the width of its 95 % interval."""
        return Cause(name, group, words, value, (value - half, value + half), unit)

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}


def find_causes(found: Comparison) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Causes of a log, the largest first, and directions that the log cannot tell apart.

    Where nothing changed, more noise is the only cause there may be.
    """
    drifted, tested = found.score > 1.0, found.tested
    if found.model.body is None:
        words = f"{100 * found.bound_test[0]:.0f} % of the rows are beyond the maps' bound"
        return ((Cause("unknown", "maps", words),) if drifted else ()), ()
    if drifted and not found.explained:
        return (Cause("unknown", "", found.why_not()),), ()
    causes: list[Cause] = []
    notes: list[str] = []
    noise, usual = tested.noise, tested.usual
    if drifted:
        causes = _of_frame(found) + _of_change(found)
        notes = _twins(found, causes)
        if not causes:
            words = "no single change of the sensor, a joint or a link explains it"
            causes.append(Cause("unknown", "", words))
        if found.changed:  # a large change is not linear: what the best one leaves
            noise = min(noise, found.explanations[0].noise * float(found.reference.sizes[0]))
    elif tested.noisy is not None:  # an encoder, or what it drives
        joint, sd = tested.noisy
        name, turns = found.model.about.joint_names[joint], found.model.about.revolute[joint]
        size = f"{math.degrees(sd):.2g} deg" if turns else f"{1e3 * sd:.2g} mm"
        words = f"{name} is noisy, by {size}: its encoder, or play; no calibration mends that"
        causes.append(Cause(f"noise:{name}", "noise", words, sd, None, "rad" if turns else "m"))
    if noise >= _NOISIER * usual:
        factor, unit = for_people(found.unit_seen)
        words = f"the scatter is {factor * noise:.3g} {unit} per axis, {noise / usual:.2g} times "
        causes.append(Cause("noise", "noise", words + "the usual", noise, None, found.unit_seen))
    return tuple(causes), tuple(notes)


def _lost(name: str) -> Cause:
    return Cause(f"lost:{name}", "gain", f"{name} no longer moves the tip", 0.0, None, "1")


def _of_frame(found: Comparison) -> list[Cause]:
    """What had to be found before anything else: mirrors, senses, units."""
    reference, names, ratio = found.reference, found.model.about.joint_names, found.reference.scale
    causes = []
    if reference.mirrored:
        words = "the log's positions are mirrored, compared with the model"
        old = found.body.predict(found.probes)
        new = reference.structure.predict(found.probes, reference.beta)
        if old.shape[1] == 2 and Alignment.between(old, new).swapped:
            words = "x and y of the log are exchanged, compared with the model"
        causes.append(Cause("mirror", "view.mirror", words))
    for k in reference.turned:
        causes.append(
            Cause(f"sign:{names[k]}", "sign", f"{names[k]} turns the other way than before")
        )
    causes += [_lost(names[k]) for k in reference.locked]
    if ratio != 1.0:
        words = f"the log's positions are {ratio:.4g} times the model's{unit_hint(ratio)}"
        causes.append(Cause("scale", "view.scale", words, ratio, None, "1"))
    return causes


def _of_change(found: Comparison) -> list[Cause]:
    """Each parameter that is clearly away from where it was, the largest effect first.

    Of the simplest hypothesis; where none is clearly better than no change, of the most telling
    test.
    """
    structure, old, new = found.reference.structure, found.belief.beta, found.reference
    best, own = simplest(found.explanations), ("sensor", "lens") if found.cause == "sensor" else ""
    groups, beta, deviation = best.hypothesis, best.beta, best.deviation
    if not found.changed:
        above = [
            g.change for g in fired(found.tested.groups) if g.change and g.name.startswith(own)
        ]
        if not above:
            return []
        ix, step, deviation = above[0][0], *np.zeros((2, len(old)))
        groups = tuple(dict.fromkeys(structure.labels[k].group for k in ix.tolist()))
        step[ix], deviation[ix] = above[0][1:]
        beta = structure.retract(old, step)
    elif not groups:
        words = "the joints have waves that the model does not know: gears, or their sensors"
        return [Cause("curve", "curve", words)] * (best.waves > CREEP)
    change, size, free = beta - old, np.zeros(len(old)), np.flatnonzero(deviation)
    clear = (deviation > 0) & (np.abs(change) > _SIGNIFICANT * deviation)
    # root mean square displacement by one of each parameter
    moves = structure.linearise(found.probes, beta, free)[1]
    size[free] = np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    effect = np.abs(change * size)
    causes: list[tuple[float, Cause]] = []
    for group in groups:
        if group in FRAME or (group == "view.scale" and new.scale != 1.0):
            continue
        for _, every in parts_of(structure, group):
            told, most = every[clear[every]], float(np.abs(change[every]).max())
            whole = GROUPS[group].whole
            if whole and len(told):  # by its largest one
                told = told[[np.argmax(np.abs(change[told]))]]
            for k in told.tolist():
                moved = float(np.linalg.norm(effect[every if whole else [k]]))
                causes.append((moved, _of_parameter(found, k, change[k], deviation[k], most)))
    frame, other = indices_of(structure, FRAME), new.mirrored or new.scale != 1.0
    only = not found.changed and {*groups} <= {*filter(is_sensors, groups)}
    if FRAME[0] in groups and (other or only or clear[frame].any()):
        moved = math.inf if other else float(np.linalg.norm(effect[frame]))
        causes.append((moved, _moved_sensor(found, beta, deviation)))
    if not new.locked:  # joints that moved the tip and no longer do
        before, after = (
            np.sqrt((structure.slope(found.probes, b) ** 2).sum(axis=1).mean(axis=0))
            for b in (old, beta)
        )
        scale = min(float(np.sum(after) / max(float(np.sum(before)), 1e-300)), 1.0)
        gone = np.flatnonzero(after < 0.02 * before * scale)
        causes += [(math.inf, _lost(found.model.about.joint_names[k])) for k in gone]
    causes.sort(key=lambda pair: -pair[0])
    least = _MATTERS * max((moved for moved, _ in causes if math.isfinite(moved)), default=0.0)
    return [cause for moved, cause in causes if moved >= least]


def _of_parameter(found: Comparison, k: int, change: float, sd: float, most: float) -> Cause:
    """A cause that one parameter tells, by its change and that one's sd.

    most : the largest change of all parameters of its group and joint
    """
    label, old = found.reference.structure.labels[k], float(found.belief.beta[k])
    group, joint, half = label.group.partition(".")[0], label.joint or "", 1.96 * float(sd)
    group, change = label.group if group in ("view", "tool") else group, float(change)
    told = GROUPS[group]
    words = OFF if label.unit == "rad" and not told.whole else told.changed
    factor = math.degrees(1.0) if label.unit == "rad" else 100.0
    value = math.expm1(change) if group == "view.scale" else change
    share = f"{100 * abs(change / old) if old else math.nan:.3g} %"
    size = f" ({1e3 * abs(change):.3g} ± {1e3 * half:.2g} mm)" if label.unit == "m" else ""
    words = words.format(
        joint=joint, name=label.name, who=joint or label.name, unit=label.unit, raw=change,
        raw_half=half, value=factor * value, half=factor * half, share=share, size=size,
        longer="longer" if change > 0 else "shorter", most=math.degrees(most),
    )  # fmt: skip
    kind = group.removeprefix("view.")
    name = f"{kind}:{joint}" if joint else kind
    return Cause.measured(name, label.group, words, change, half, label.unit)


def _moved_sensor(found: Comparison, beta: Array, deviation: Array) -> Cause:
    """The sensor's frame as one cause, its rotation as the number."""
    turn, moved = found.reference.structure.groups["view.rotation"], frame_between(found, beta)
    half, value = 1.96 * float(np.linalg.norm(deviation[turn])), moved.angle
    if len(turn) == 1:  # with its sign, also of a mirrored one
        value = math.remainder(float(beta[turn[0]] - found.belief.beta[turn[0]]), 2 * math.pi)
    words = f"the sensor's frame moved: {moved.words(found.unit_seen)}"
    if half > _VAGUE:
        words += f" (the turn to ± {math.degrees(half):.2g} deg)"
    return Cause.measured("sensor", "view.rotation", words, value, half, "rad")


def frame_between(found: Comparison, beta: Array) -> Alignment:
    """The sensor's new frame, of parameters (d,), as an affine map of the old one."""
    structure, mixed = found.reference.structure, found.belief.beta.copy()
    sensors = indices_of(structure, filter(is_sensors, structure.groups))
    mixed[sensors] = beta[sensors]
    before, after = found.body.predict(found.probes), structure.predict(found.probes, mixed)
    places = slice(structure.blocks[0])
    return Alignment.between(before[:, places], after[:, places])


def _twins(found: Comparison, causes: list[Cause]) -> list[str]:
    """Add what says the same as a cause that is named; the directions that are one, in words."""
    named, about, structure = {c.cause: c for c in causes}, found.model.about, found.body.structure
    groups, beta, notes = structure.groups, found.body.beta, []
    name, turns = about.joint_names[0], about.revolute[0] and "mirror" not in named
    first, sensor = named.get(f"offset:{name}"), named.get("sensor")
    if turns and first is not None and sensor is None:
        words = f"or the sensor turned by {math.degrees(first.value or 0.0):.3g} deg about {name}"
        causes.append(replace(first, cause="sensor", group="view.rotation", words=words))
    elif turns and first is None and sensor is not None and found.changed and "offset" in groups:
        sense = int(getattr(structure, "mirror", 1))
        value, interval = sense * (sensor.value or 0.0), sensor.interval or (0.0, 0.0)
        offset, framed, frame = beta.copy(), beta.copy(), indices_of(structure, FRAME)
        offset[groups["offset"][0]] += value
        framed[frame] = found.explanations[0].beta[frame]
        seen, moved, turned = (structure.predict(found.probes, b) for b in (beta, offset, framed))
        if np.linalg.norm(turned - moved) <= _ALIKE * np.linalg.norm(turned - seen) + 1e-12:
            words, half = f"or {name} is off by {math.degrees(value):.3g} deg", np.ptp(interval) / 2
            first = Cause.measured(f"offset:{name}", "offset", words, value, float(half), "rad")
            causes.append(first)
    if turns and first is not None:
        notes.append(
            f"an offset of the first joint and a turn of the sensor about its axis {_WHICH}"
        )
    links = [named.get(f"length:{each}") for each in about.joint_names]
    shares = [
        np.array(c.interval) / found.belief.beta[k]
        for c, k in zip(links, groups.get("length", ()), strict=False)
        if c is not None and c.interval is not None
    ]
    alike = len(shares) == len(links) and np.max(shares, axis=0)[0] <= np.min(shares, axis=0)[1]
    scaled = "scale" in named and named["scale"].interval is not None and "length" in groups
    if (alike or scaled) and all(about.revolute):
        notes.append(f"a sensor that shows all larger and links that are all longer {_WHICH}")
    return notes if found.cause is None else []
