"""Causes: what changed between a model and a log, in numbers and in words.

What a log cannot tell apart is said with the cause that was named: a sensor that was turned about
the first joint's axis and that joint's offset; a sensor that shows all larger and longer links.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..common.arrays import Array
from ..common.wording import for_people
from ..model.alignment import Alignment
from .comparison import Comparison
from .explain import simplest
from .hypotheses import FRAME, GROUPS, Cause, indices_of, is_sensors, parts_of
from .score import fired
from .settings import CREEP, NOISIER

_EXACT = 1e3  # times the noise of a model: it learned from exact samples
_SIGNIFICANT = 2.6  # standard deviations from which a parameter is said to have changed
_ALIKE = 0.15  # share of a displacement that may differ between two words for it
_VAGUE = math.radians(1.0)  # half an interval of a turn from which it is worth a word
_MATTERS = 0.05  # share of the largest displacement from which a cause is named
_WHICH = "are the same to this log: give `cause='joints'` or `cause='sensor'` if you know which"


def find_causes(found: Comparison) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Causes of a log, the largest first, and directions that the log cannot tell apart.

    Where nothing changed, more noise is the only cause there may be.
    """
    drifted, tested, about = found.score > 1.0, found.tested, found.model.about
    if found.model.body is None:
        words = f"{100 * found.bound_test[0]:.0f} % of the rows are beyond the maps' bound"
        return ((Cause("unknown", "maps", words),) if drifted else ()), ()
    if drifted and not found.explained:
        return (Cause("unknown", "", found.why_not()),), ()
    causes: list[Cause] = []
    notes: list[str] = []
    if drifted:
        causes = [*found.reference.causes, *_of_change(found)]
        notes = _twins(found, causes)
        if not causes:
            words = "no single change of the sensor, a joint or a link explains it"
            causes.append(Cause("unknown", "", words))
    elif tested.noisy is not None:  # an encoder, or what it drives
        (joint, sd), unit = tested.noisy, "rad" if about.revolute[tested.noisy[0]] else "m"
        factor, shown = for_people(unit)
        name, size = about.joint_names[joint], f"{factor * sd:.2g} {shown}"
        words = f"{name} is noisy, by {size}: its encoder, or play; no calibration mends that"
        causes.append(Cause(f"noise:{name}", "noise", words, sd, None, unit))
    # a large change is not linear: what the best one leaves
    left = (
        found.explanations[0].noise * float(found.reference.sizes[0]) if found.changed else np.inf
    )
    if tested.noisier and (noise := min(tested.noise, left)) > NOISIER * tested.usual:
        factor, unit = for_people(found.unit_seen)
        times = noise / tested.usual  # of exact samples there is no usual one
        more = f", {times:.2g} times the usual" if times < _EXACT else ""
        words = f"the scatter is {factor * noise:.3g} {unit} per axis{more}"
        causes.append(Cause("noise", "noise", words, noise, None, found.unit_seen))
    if found.tool.score > 1.0:
        turn, angle = found.tool.turn, float(np.linalg.norm(found.tool.turn))
        half = 1.96 * float(np.sqrt(turn @ found.tool.covariance @ turn)) / angle
        size = f"{np.degrees(angle):.3g} deg"
        words = f"the tool is turned by {size} (its orientation, not its place)"
        causes.append(Cause.measured("tool", "tool.rotation", words, angle, half, "rad"))
    if (board := about.options.get("board")) is not None:
        causes = _told_once(causes, "camera" if board["eye"] == "hand" else "board")
    return tuple(causes), (*notes, *found.tool.notes)


def _told_once(causes: list[Cause], what: str) -> list[Cause]:
    """Causes in which a camera or a board that moved in the hand stands once."""
    moved = sorted(
        (c for c in causes if c.group in ("tool", "tool.rotation")), key=lambda c: c.unit != "rad"
    )
    if not moved:
        return causes
    factor, unit = for_people(moved[0].unit)
    low, high = (factor * end for end in moved[0].interval or (0.0, 0.0))
    how = "turned in its mount by" if unit == "deg" else "moved in its mount, what it sees by"
    words = f"the {what} has {how} {abs(low + high) / 2:.3g} ± {(high - low) / 2:.2g} {unit}"
    told = replace(moved[0], cause="tool", words=words)
    return [told, *(cause for cause in causes if cause not in moved)]


def _of_change(found: Comparison) -> list[Cause]:
    """Each parameter that is clearly away from where it was, the largest effect first.

    Of the simplest hypothesis, or of the most telling test where none is clearly better than none.
    """
    structure, old, best = (
        found.reference.structure,
        found.belief.beta,
        simplest(found.explanations),
    )
    groups, beta, deviation = best.hypothesis, best.beta, best.deviation
    if not found.changed:
        own = ("sensor", "lens") if found.cause == "sensor" else ""
        above = [g.change for g in fired(found.tested.groups) if g.name.startswith(own)]
        if not above or above[0] is None:
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
    told = {cause.cause for cause in found.reference.causes}
    causes: list[tuple[float, Cause]] = []
    for group in groups:
        if group in FRAME or (group == "view.scale" and "scale" in told):
            continue
        for _, every in parts_of(structure, group):
            some, most = every[clear[every]], float(np.abs(change[every]).max())
            whole = GROUPS[group.partition(":")[0]].whole
            if whole and len(some):  # by its largest one
                some = some[[np.argmax(np.abs(change[some]))]]
            for k in some.tolist():
                moved = float(np.linalg.norm(effect[every if whole else [k]]))
                causes.append((moved, _of_parameter(found, k, change[k], deviation[k], most)))
    frame, other = indices_of(structure, FRAME), not told.isdisjoint(("mirror", "scale"))
    only = not found.changed and {*groups} <= {*filter(is_sensors, groups)}
    if FRAME[0] in groups and (other or only or clear[frame].any()):
        moved = math.inf if other else float(np.linalg.norm(effect[frame]))
        causes.append((moved, _moved_sensor(found, beta, deviation)))
    causes.sort(key=lambda pair: -pair[0])
    least = _MATTERS * max((moved for moved, _ in causes if math.isfinite(moved)), default=0.0)
    return [cause for moved, cause in causes if moved >= least]


def _of_parameter(found: Comparison, k: int, change: float, sd: float, most: float) -> Cause:
    """A cause that one parameter tells, by its change and that one's sd.

    most : the largest change of all parameters of its group and joint
    """
    label, old = found.reference.structure.labels[k], float(found.belief.beta[k])
    group = "curve" if label.group.startswith("curve") else label.group
    joint, half, change = label.joint or "", 1.96 * float(sd), float(change)
    factor, unit = for_people(label.unit) if label.unit != "1" else (100.0, "%")
    size = f" ({factor * abs(change):.3g} ± {factor * half:.2g} mm)" if unit == "mm" else ""
    words = GROUPS[group].changed.format(
        joint=joint, name=label.name, unit=unit, half=factor * half, most=math.degrees(most),
        value=factor * (math.expm1(change) if group == "view.scale" else change), size=size,
        share=f"{100 * abs(change / old) if old else math.nan:.3g} %",
        longer="longer" if change > 0 else "shorter",
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
    groups, beta, notes, name = structure.groups, found.body.beta, [], about.joint_names[0]
    first, sensor = named.get(f"offset:{name}"), named.get("sensor")
    if about.revolute[0] and "mirror" not in named:
        if first is None and sensor is not None and found.changed and "offset" in groups:
            # whether an offset alone moves the tip as the frame did
            value = getattr(structure, "mirror", 1) * (sensor.value or 0.0)
            offset, framed, frame = beta.copy(), beta.copy(), indices_of(structure, FRAME)
            offset[groups["offset"][0]] += value
            framed[frame] = found.explanations[0].beta[frame]
            seen, moved, turned = (
                structure.predict(found.probes, b) for b in (beta, offset, framed)
            )
            if np.linalg.norm(turned - moved) <= _ALIKE * np.linalg.norm(turned - seen) + 1e-12:
                words = f"or {name} is off by {math.degrees(value):.3g} deg"
                half = float(np.ptp(sensor.interval or (0.0,))) / 2
                first = Cause.measured(f"offset:{name}", "offset", words, value, half, "rad")
                causes.append(first)
        elif first is not None and sensor is None:
            turn = math.degrees(first.value or 0.0)
            words = f"or the sensor turned by {turn:.3g} deg about {name}"
            causes.append(replace(first, cause="sensor", group="view.rotation", words=words))
        if first is not None:
            told = "an offset of the first joint and a turn of the sensor about its axis"
            notes.append(f"{told} {_WHICH}")
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
