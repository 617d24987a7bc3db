"""Causes: what changed between a model and a log, in numbers and in words.

`check` and `adapt` ask here with the same comparison, so that both say the same of one log.
What a log cannot tell apart is said with the cause that was named: a sensor that was turned about
the first joint's axis and that joint's offset are the same; so are a sensor that shows all larger
and links that are all longer.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..body.parameters import Label
from ..common.arrays import Array
from ..common.wording import for_people
from ..model.alignment import Alignment
from ..samples.diagnosis import unit_hint
from .comparison import Comparison
from .explain import simplest
from .hypotheses import FRAME, NOTHING, is_sensors, parts_of
from .score import fired
from .settings import CREEP

_SIGNIFICANT = 2.6  # standard deviations from which a parameter is said to have changed
_NOISIER = 1.5  # noise over the usual one from which it is worth a word
_ALIKE = 0.15  # share of a displacement that may differ between two words for it
_VAGUE = math.radians(1.0)  # half an interval of a turn from which it is worth a word
_MATTERS = 0.05  # share of the largest displacement from which a cause is named
_WHICH = "are the same to this log: give `cause='joints'` or `cause='sensor'` if you know which"


class Words(NamedTuple):
    """A group of parameters in words."""

    kept: str  # of what an adaptation leaves as it was; "" where that is not told
    # of a change; `value` and `half` its interval are in deg or %
    changed: str = "{name} changed by {raw:.4g} ± {raw_half:.2g} {unit}"
    whole: bool = False  # whether all of its parameters are one cause


_OFF = "{who} is off by {value:+.3g} ± {half:.2g} deg"
WORDS = {
    "view.rotation": Words("the sensor's frame"),
    "view.scale": Words("the sensor's scale", "the sensor's scale changed by {value:+.3g} %", True),
    "view.shear": Words("", "the sensor's axes are stretched or sheared", True),
    "view.tilt": Words("the camera's tilt", "the camera is tilted", True),
    "lens": Words("the lens", "the sensor's frame is bent, as by a lens", True),
    "length": Words("the links' lengths", "the link of {joint} is {share}{size} {longer}"),
    "offset": Words("the joints' offsets", _OFF),
    "gain": Words(
        "the joints' gains", "{joint} moves {value:+.3g} ± {half:.2g} % further than it says"
    ),
    "elastic": Words("elasticity", "{joint} bends under load, by up to {most:.3g} deg", True),
    "placement": Words("the joints' placements"),
    "tool": Words("the tool"),
    "curve": Words("", "{joint} has another error curve, by up to {most:.3g} deg", True),
}
"""What is said of each group; its numbers are those of the posterior."""


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

    @staticmethod
    def of_parameter(
        label: Label, old: float, change: float, sd: float, most: float = 0.0
    ) -> Cause:
        """A cause that one parameter tells: its old value, its change and that one's sd.

        most : the largest change of all parameters of its group and joint
        """
        group, joint, half = label.group.partition(".")[0], label.joint or "", 1.96 * sd
        group = label.group if group in ("view", "tool") else group
        told = WORDS.get(group, Words(""))
        if label.unit == "rad" and not told.whole:
            told = Words("", _OFF)
        factor = math.degrees(1.0) if label.unit == "rad" else 100.0
        value = math.expm1(change) if group == "view.scale" else change
        share = f"{100 * abs(change / old) if old else math.nan:.3g} %"
        size = f" ({1e3 * abs(change):.3g} ± {1e3 * half:.2g} mm)" if label.unit == "m" else ""
        words = told.changed.format(
            joint=joint, name=label.name, who=joint or label.name, unit=label.unit, raw=change,
            raw_half=half, value=factor * value, half=factor * half, share=share, size=size,
            longer="longer" if change > 0 else "shorter", most=math.degrees(most),
        )  # fmt: skip
        kind = group.removeprefix("view.")
        return Cause.measured(
            f"{kind}:{joint}" if joint else kind, label.group, words, change, half, label.unit
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}


def find_causes(found: Comparison) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Causes of a log, the largest first, and directions that the log cannot tell apart.

    Where nothing changed, more noise is the only cause there may be.
    """
    drifted = found.score > 1.0
    if found.model.body is None:
        words = f"{100 * found.beyond:.0f} % of the rows are beyond the maps' bound"
        return ((Cause("unknown", "maps", words),) if drifted else ()), ()
    if drifted and not found.explained:
        return (Cause("unknown", "", found.why_not()),), ()
    causes: list[Cause] = []
    notes: list[str] = []
    if drifted:
        causes += _of_frame(found) + _of_change(found)
        notes = _twins(found, causes)
        if not causes:
            words = "no single change of the sensor, a joint or a link explains it"
            causes.append(Cause("unknown", "", words))
    noise, usual, noisy = found.tested.noise, found.tested.usual, found.tested.noisy
    if noisy is not None and not drifted:  # an encoder, or what it drives
        joint, sd = noisy
        name, turns = found.model.about.joint_names[joint], found.model.about.revolute[joint]
        size = f"{math.degrees(sd):.2g} deg" if turns else f"{1e3 * sd:.2g} mm"
        words = f"{name} is noisy, by {size}: its encoder, or play; no calibration mends that"
        unit = "rad" if turns else "m"
        causes.append(Cause(f"noise:{name}", "noise", words, sd, None, unit))
    if drifted and found.changed:  # a large change is not linear: what the best one leaves
        noise = min(noise, found.explanations[0].noise * float(found.reference.sizes[0]))
    if noise >= _NOISIER * usual:
        factor, unit = for_people(found.unit_seen)
        words = f"the scatter is {factor * noise:.3g} {unit} per axis, {noise / usual:.2g} times "
        causes.append(Cause("noise", "noise", words + "the usual", noise, None, found.unit_seen))
    return tuple(causes), tuple(notes)


def _lost(name: str) -> Cause:
    return Cause(f"lost:{name}", "gain", f"{name} no longer moves the tip", 0.0, None, "1")


def _of_frame(found: Comparison) -> list[Cause]:
    """What had to be found before anything else: mirrors, senses, units."""
    reference, names = found.reference, found.model.about.joint_names
    causes = []
    if reference.mirrored:
        words = "the log's positions are mirrored, compared with the model"
        old = found.body.predict(found.probes)
        new = reference.structure.predict(found.probes, reference.beta)
        if old.shape[1] == 2 and Alignment.between(old, new).swapped:
            words = "x and y of the log are exchanged, compared with the model"
        causes.append(Cause("mirror", "view.mirror", words))
    for k in reference.turned:
        words = f"{names[k]} turns the other way than before"
        causes.append(Cause(f"sign:{names[k]}", "sign", words))
    causes += [_lost(names[k]) for k in reference.locked]
    if reference.scale != 1.0:
        ratio = reference.scale
        words = f"the log's positions are {ratio:.4g} times the model's{unit_hint(ratio)}"
        causes.append(Cause("scale", "view.scale", words, ratio, None, "1"))
    return causes


def _of_change(found: Comparison) -> list[Cause]:
    """Each parameter that is clearly away from where it was, the largest effect first.

    It is that of the simplest hypothesis, or of the most telling test where no hypothesis is
    clearly better than no change.
    """
    structure, old = found.reference.structure, found.belief.beta
    if found.changed:
        best = simplest(found.explanations)
        if best.hypothesis == NOTHING:
            words = "the joints have waves that the model does not know: gears, or their sensors"
            return [Cause("curve", "curve", words)] if best.waves > CREEP else []
        groups, beta, deviation = best.hypothesis.groups, best.beta, best.deviation
    else:
        own = "" if found.cause != "sensor" else ("sensor", "lens")
        above = [g for g in fired(found.tested.groups) if g.name.startswith(own)]
        if not above:
            return []
        ix, step, deviation = above[0].indices, *np.zeros((2, len(old)))
        groups = tuple(dict.fromkeys(structure.labels[int(k)].group for k in ix))
        step[ix], deviation[ix] = above[0].estimate, above[0].deviation
        beta = structure.retract(old, step)
    change, size = beta - old, np.zeros(len(old))
    clear = (deviation > 0) & (np.abs(change) > _SIGNIFICANT * deviation)
    # root mean square displacement by one of each parameter
    free = np.flatnonzero(deviation)
    moves = structure.linearise(found.probes, beta, free)[1]
    size[free] = np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    causes: list[tuple[float, Cause]] = []
    for group in groups:
        if group in FRAME or (group == "view.scale" and found.reference.scale != 1.0):
            continue
        whole = group in WORDS and WORDS[group].whole
        for _, every in parts_of(structure, group):
            told, most = every[clear[every]], float(np.abs(change[every]).max())
            if whole and len(told):  # by its largest one
                told = told[[np.argmax(np.abs(change[told]))]]
            for k in told.tolist():
                of = every if whole else [k]
                moved = float(np.linalg.norm(change[of] * size[of]))
                label = structure.labels[k]
                cause = Cause.of_parameter(
                    label, old[k], float(change[k]), float(deviation[k]), most
                )
                causes.append((moved, cause))
    frame = np.concatenate([structure.groups[g] for g in FRAME])
    new = found.reference.mirrored or found.reference.scale != 1.0
    only = not found.changed and {*groups} <= {*filter(is_sensors, groups)}
    if FRAME[0] in groups and (new or only or clear[frame].any()):
        moved = math.inf if new else float(np.linalg.norm(change[frame] * size[frame]))
        causes.append((moved, _moved_sensor(found, beta, deviation)))
    if not found.reference.locked:  # joints that moved the tip and no longer do
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


def _moved_sensor(found: Comparison, beta: Array, deviation: Array) -> Cause:
    """The sensor's frame as one cause, its rotation as the number."""
    turn, moved = found.reference.structure.groups["view.rotation"], frame_between(found, beta)
    half, value = 1.96 * float(np.linalg.norm(deviation[turn])), moved.angle
    if len(turn) == 1:  # with its sign, also of a mirrored one
        value = float(beta[turn[0]] - found.belief.beta[turn[0]])
        value = (value + math.pi) % (2 * math.pi) - math.pi
    words = f"the sensor's frame moved: {moved.words(found.unit_seen)}"
    if half > _VAGUE:
        words += f" (the turn to ± {math.degrees(half):.2g} deg)"
    return Cause.measured("sensor", "view.rotation", words, value, half, "rad")


def frame_between(found: Comparison, beta: Array) -> Alignment:
    """The sensor's new frame, of parameters (d,), as an affine map of the old one."""
    structure, mixed = found.reference.structure, found.belief.beta.copy()
    for name, ix in structure.groups.items():
        if is_sensors(name):
            mixed[ix] = beta[ix]
    before, after = found.body.predict(found.probes), structure.predict(found.probes, mixed)
    places = slice(structure.blocks[0])
    return Alignment.between(before[:, places], after[:, places])


def _twins(found: Comparison, causes: list[Cause]) -> list[str]:
    """Add what says the same as a cause that is named; the directions that are one, in words."""
    named, about, structure = {c.cause: c for c in causes}, found.model.about, found.body.structure
    groups, beta, notes = structure.groups, found.body.beta, []
    name, turns = about.joint_names[0], about.revolute[0] and "mirror" not in named
    first, sensor = named.get(f"offset:{name}"), named.get("sensor")
    sense = int(getattr(structure, "mirror", 1))
    if turns and first is not None and sensor is None:
        words = f"or the sensor turned by {math.degrees(first.value or 0.0):.3g} deg about {name}"
        causes.append(replace(first, cause="sensor", group="view.rotation", words=words))
    elif turns and first is None and sensor is not None and found.changed and "offset" in groups:
        value, (low, high) = sense * (sensor.value or 0.0), sensor.interval or (0.0, 0.0)
        offset, framed = beta.copy(), beta.copy()
        offset[groups["offset"][0]] += value
        for group in FRAME:
            framed[groups[group]] = found.explanations[0].beta[groups[group]]
        seen, moved, turned = (structure.predict(found.probes, b) for b in (beta, offset, framed))
        if np.linalg.norm(turned - moved) <= _ALIKE * np.linalg.norm(turned - seen) + 1e-12:
            words = f"or {name} is off by {math.degrees(value):.3g} deg"
            interval = min(sense * low, sense * high), max(sense * low, sense * high)
            first = Cause(f"offset:{name}", "offset", words, value, interval, "rad")
            causes.append(first)
    if turns and first is not None:
        notes.append(
            f"an offset of the first joint and a turn of the sensor about its axis {_WHICH}"
        )
    lengths = groups.get("length", ())
    if not all(about.revolute) or len(lengths) != len(about.joint_names):
        return notes if found.cause is None else []
    same = "scale" in named and named["scale"].interval is not None
    links = [named.get(f"length:{each}") for each in about.joint_names]
    shares = [
        np.array([c.value, *c.interval]) / found.belief.beta[k]
        for c, k in zip(links, lengths, strict=True)
        if c is not None and c.interval is not None
    ]
    if len(shares) == len(links) and not same:
        value, low, high = np.transpose(shares)
        share, interval = float(value.mean()), (math.log1p(low.max()), math.log1p(high.min()))
        if same := interval[0] <= interval[1]:
            words = f"or the sensor shows all {100 * abs(share):.3g} % "
            words += "larger" if share > 0 else "smaller"
            causes.append(Cause("scale", "view.scale", words, math.log1p(share), interval, "1"))
    if same:
        notes.append(f"a sensor that shows all larger and links that are all longer {_WHICH}")
    return notes if found.cause is None else []
