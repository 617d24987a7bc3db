"""Causes: what changed between a model and a log, in numbers and in words.

What a log cannot tell apart is said with the cause that was named: a sensor that was turned about
the first joint's axis and that joint's offset; a sensor that shows all larger and longer links.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..body.settings import NATS
from ..common.arrays import Array
from ..common.wording import for_people
from ..model.alignment import Alignment
from ..model.model import Model
from .causes import FRAME, GROUPS, Cause, indices_of, is_sensors, parts_of
from .evidence import Evidence
from .explain import simplest
from .settings import CREEP, NOISIER
from .tests import Play, fired

_EXACT = 1e3  # times the noise of a model: it learned from exact samples
_SIGNIFICANT = 2.6  # standard deviations from which a parameter is said to have changed
_ALIKE = 0.15  # share of a displacement that may differ between two words for it
_VAGUE = math.radians(1.0)  # half an interval of a turn from which it is worth a word
_MATTERS = 0.05  # share of the largest displacement from which a cause is named
_WHICH = "are the same to this log: give `cause='joints'` or `cause='sensor'` if you know which"


def causes_of(evidence: Evidence) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Causes of a log, the largest first, and notes on what the log cannot tell apart.

    Where nothing changed, more noise is the only cause there may be.
    """
    drifted = evidence.score > 1.0
    about = evidence.rows.model.about
    if drifted and not evidence.explained:
        return (Cause("unknown", "", evidence.why_not()),), ()
    causes: list[Cause] = []
    notes: list[str] = []
    if drifted:
        causes = [*evidence.reference.causes, *_of_change(evidence)]
        notes = _twins(evidence, causes)
        if not causes:
            words = "no single change of the sensor, a joint or a link explains it"
            causes.append(Cause("unknown", "", words))
    elif evidence.tests.noisy is not None:
        causes.append(_noisy_joint(evidence))
    scatter = _scatter(evidence)
    if scatter is not None:
        causes.append(scatter)
    if evidence.tool.score > 1.0:
        causes.append(_turned_tool(evidence))
    if (board := about.options.get("board")) is not None:
        causes = _told_once(causes, "camera" if board["eye"] == "hand" else "board")
    return tuple(causes), (*notes, *evidence.tool.notes)


def maps_cause(beyond: float) -> Cause:
    """The cause where maps without a body do not fit: a share of the rows beyond their bound."""
    return Cause(
        "unknown",
        "maps",
        f"{100 * beyond:.0f} % of the rows are beyond the maps' bound",
    )


def play_cause(play: Play, model: Model) -> Cause:
    """A joint that has more play than the model knows, by all of it."""
    about = model.about
    name = about.joint_names[play.joint]
    unit = "rad" if about.revolute[play.joint] else "m"
    factor, shown = for_people(unit)
    half = 2 * 1.96 * play.deviation
    words = (
        f"{name} has {factor * 2 * play.half[play.joint]:.2g} ± {factor * half:.2g} {shown} of play that the "
        "model does not know: `calib train` learns it from a log that goes both ways"
    )
    return Cause.measured(
        f"backlash:{name}",
        "backlash",
        words,
        2 * float(play.half[play.joint]),
        half,
        unit,
    )


def _noisy_joint(evidence: Evidence) -> Cause:
    """A joint whose encoder, or what it drives, is noisy."""
    about = evidence.rows.model.about
    assert evidence.tests.noisy is not None  # noqa: S101 - the caller looked
    joint, sd = evidence.tests.noisy
    unit = "rad" if about.revolute[joint] else "m"
    factor, shown = for_people(unit)
    name = about.joint_names[joint]
    words = (
        f"{name} is noisy, by {factor * sd:.2g} {shown}: its encoder, or play; no calibration "
        "mends that"
    )
    return Cause(f"noise:{name}", "noise", words, sd, None, unit)


def _scatter(evidence: Evidence) -> Cause | None:
    """A scatter that is larger than usual, where that is no chance."""
    tests = evidence.tests
    unit_seen = evidence.unit_seen
    noise = tests.noise
    if evidence.attributed:  # a large change is not linear: what the best one leaves
        size = float(evidence.reference.sizes[0])
        noise = min(noise, evidence.findings[0].noise * size)
    if not tests.noisier or noise <= NOISIER * tests.usual:
        return None
    factor, unit = for_people(unit_seen)
    times = noise / tests.usual
    words = f"the scatter is {factor * noise:.3g} {unit} per axis"
    if times < _EXACT:  # of exact samples there is no usual one
        words += f", {times:.2g} times the usual"
    return Cause("noise", "noise", words, noise, None, unit_seen)


def _turned_tool(evidence: Evidence) -> Cause:
    """A tool that is turned about its own tip, as orientations tell."""
    turn = evidence.tool.turn
    angle = float(np.linalg.norm(turn))
    half = 1.96 * float(np.sqrt(turn @ evidence.tool.covariance @ turn)) / angle
    words = f"the tool is turned by {np.degrees(angle):.3g} deg (its orientation, not its place)"
    return Cause.measured("tool", "tool.rotation", words, angle, half, "rad")


def _told_once(causes: list[Cause], what: str) -> list[Cause]:
    """Causes in which a camera or a board that moved in the hand stands once."""
    moved = sorted(
        (c for c in causes if c.group in ("tool", "tool.rotation")),
        key=lambda c: c.unit != "rad",
    )
    if not moved:
        return causes
    factor, unit = for_people(moved[0].unit)
    low, high = (factor * end for end in moved[0].interval or (0.0, 0.0))
    how = (
        "turned in its mount by"
        if unit == "deg"
        else "moved in its mount, what it sees by"
    )
    words = f"the {what} has {how} {abs(low + high) / 2:.3g} ± {(high - low) / 2:.2g} {unit}"
    told = replace(moved[0], cause="tool", words=words)
    return [told, *(cause for cause in causes if cause not in moved)]


def _of_change(evidence: Evidence) -> list[Cause]:
    """Each parameter that is clearly away from where it was, the largest effect first.

    Of the simplest hypothesis, or of the most telling test where none is clearly better than none.
    """
    structure = evidence.reference.structure
    old = evidence.prior.beta
    best = simplest(evidence.findings)
    groups = best.groups
    beta = best.beta
    deviation = best.deviation
    if not evidence.attributed:
        own = ("sensor", "lens") if evidence.cause == "sensor" else ""
        above = [
            g.change for g in fired(evidence.tests.groups) if g.name.startswith(own)
        ]
        if not above or above[0] is None:
            return []
        indices, sizes, deviations = above[0]
        groups = tuple(
            dict.fromkeys(structure.labels[k].group for k in indices.tolist())
        )
        step = np.zeros(len(old))
        step[indices] = sizes
        deviation = np.zeros(len(old))
        deviation[indices] = deviations
        beta = structure.retract(old, step)
    elif not groups:
        words = "the joints have waves that the model does not know: gears, or their sensors"
        return [Cause("curve", "curve", words)] * (best.level.waves > CREEP)
    change = beta - old
    size = np.zeros(len(old))
    free = np.flatnonzero(deviation)
    clear = (deviation > 0) & (np.abs(change) > _SIGNIFICANT * deviation)
    # root mean square displacement by one of each parameter
    moves = structure.linearise(evidence.rows.probes, beta, free)[1]
    size[free] = np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    effect = np.abs(change * size)
    told = {cause.cause for cause in evidence.reference.causes}
    causes: list[tuple[float, Cause]] = []
    for group in groups:
        if group in FRAME or (group == "view.scale" and "scale" in told):
            continue
        for _, every in parts_of(structure, group):
            some = every[clear[every]]
            most = float(np.abs(change[every]).max())
            whole = GROUPS[group.partition(":")[0]].whole
            if whole and len(some):  # by its largest one
                some = some[[np.argmax(np.abs(change[some]))]]
            for k in some.tolist():
                moved = float(np.linalg.norm(effect[every if whole else [k]]))
                causes.append(
                    (moved, _of_parameter(evidence, k, change[k], deviation[k], most))
                )
    frame = indices_of(structure, FRAME)
    other = not told.isdisjoint(("mirror", "scale"))
    only = not evidence.attributed and {*groups} <= {*filter(is_sensors, groups)}
    if FRAME[0] in groups and (other or only or clear[frame].any()):
        moved = math.inf if other else float(np.linalg.norm(effect[frame]))
        causes.append((moved, _moved_sensor(evidence, beta, deviation)))
    causes.sort(key=lambda pair: -pair[0])
    least = _MATTERS * max(
        (moved for moved, _ in causes if math.isfinite(moved)), default=0.0
    )
    return [cause for moved, cause in causes if moved >= least]


def _half_width(evidence: Evidence, k: int, change: float, sd: float) -> float:
    """Half of the 95 % interval of a parameter's change.

    It holds what the other explanations say that the evidence hardly tells from the best: rows
    that show a sum of two changes do not show each.
    """
    half = 1.96 * sd
    if not evidence.attributed:
        return half
    best = evidence.findings[0].evidence
    for other in evidence.findings:
        if other.evidence > best - NATS:
            apart = abs(float(other.beta[k] - evidence.prior.beta[k]) - change)
            half = max(half, apart + 1.96 * float(other.deviation[k]))
    return half


def _of_parameter(
    evidence: Evidence, k: int, change: float, sd: float, most: float
) -> Cause:
    """A cause that one parameter tells, by its change and that one's sd.

    most : the largest change of all parameters of its group and joint
    """
    label = evidence.reference.structure.labels[k]
    old = float(evidence.prior.beta[k])
    change = float(change)
    half = _half_width(evidence, k, change, float(sd))
    group = "curve" if label.group.startswith("curve") else label.group
    joint = label.joint or ""
    factor, unit = for_people(label.unit) if label.unit != "1" else (100.0, "%")
    size = ""
    if unit == "mm":
        size = f" ({factor * abs(change):.3g} ± {factor * half:.2g} mm)"
    value = math.expm1(change) if group == "view.scale" else change
    words = GROUPS[group].changed.format(
        joint=joint,
        name=label.name,
        unit=unit,
        half=factor * half,
        most=math.degrees(most),
        value=factor * value,
        size=size,
        share=f"{100 * abs(change / old) if old else math.nan:.3g} %",
        longer="longer" if change > 0 else "shorter",
    )
    kind = group.removeprefix("view.")
    name = f"{kind}:{joint}" if joint else kind
    return Cause.measured(name, label.group, words, change, half, label.unit)


def _moved_sensor(evidence: Evidence, beta: Array, deviation: Array) -> Cause:
    """The sensor's frame as one cause, its rotation as the number."""
    turn = evidence.reference.structure.groups["view.rotation"]
    moved = frame_between(evidence, beta)
    half = 1.96 * float(np.linalg.norm(deviation[turn]))
    value = moved.angle
    if len(turn) == 1:  # with its sign, also of a mirrored one
        value = math.remainder(
            float(beta[turn[0]] - evidence.prior.beta[turn[0]]), 2 * math.pi
        )
    words = f"the sensor's frame moved: {moved.words(evidence.unit_seen)}"
    if half > _VAGUE:
        words += f" (the turn to ± {math.degrees(half):.2g} deg)"
    return Cause.measured("sensor", "view.rotation", words, value, half, "rad")


def frame_between(evidence: Evidence, beta: Array) -> Alignment:
    """The sensor's new frame, of parameters (d,), as an affine map of the old one."""
    structure = evidence.reference.structure
    probes = evidence.rows.probes
    mixed = evidence.prior.beta.copy()
    sensors = indices_of(structure, filter(is_sensors, structure.groups))
    mixed[sensors] = beta[sensors]
    before = evidence.rows.body.predict(probes)
    after = structure.predict(probes, mixed)
    places = slice(structure.blocks[0])
    return Alignment.between(before[:, places], after[:, places])


def _twins(evidence: Evidence, causes: list[Cause]) -> list[str]:
    """Add what says the same as a cause that is named; the directions that are one, in words."""
    about = evidence.rows.model.about
    by_name = {cause.cause: cause for cause in causes}
    notes: list[str] = []
    if about.revolute[0] and "mirror" not in by_name:
        notes += _turns_of_the_base(evidence, by_name, causes)
    if all(about.revolute) and _all_larger(evidence, by_name):
        notes.append(
            f"a sensor that shows all larger and links that are all longer {_WHICH}"
        )
    return notes if evidence.cause is None else []


def _turns_of_the_base(
    evidence: Evidence, by_name: dict[str, Cause], causes: list[Cause]
) -> list[str]:
    """An offset of the first joint beside a sensor that turned about its axis, or the reverse."""
    name = evidence.rows.model.about.joint_names[0]
    offset = by_name.get(f"offset:{name}")
    sensor = by_name.get("sensor")
    if offset is None and sensor is not None and _is_an_offset(evidence, sensor):
        mirror = getattr(evidence.rows.body.structure, "mirror", 1)
        value = mirror * (sensor.value or 0.0)
        words = f"or {name} is off by {math.degrees(value):.3g} deg"
        half = float(np.ptp(sensor.interval or (0.0,))) / 2
        offset = Cause.measured(f"offset:{name}", "offset", words, value, half, "rad")
        causes.append(offset)
    elif offset is not None and sensor is None:
        turn = math.degrees(offset.value or 0.0)
        words = f"or the sensor turned by {turn:.3g} deg about {name}"
        causes.append(
            replace(offset, cause="sensor", group="view.rotation", words=words)
        )
    if offset is None:
        return []
    return [
        f"an offset of the first joint and a turn of the sensor about its axis {_WHICH}"
    ]


def _is_an_offset(evidence: Evidence, sensor: Cause) -> bool:
    """Whether an offset of the first joint alone moves the tip as the frame did."""
    body = evidence.rows.body
    probes = evidence.rows.probes
    structure = body.structure
    if not evidence.attributed or "offset" not in structure.groups:
        return False
    frame = indices_of(structure, FRAME)
    offset = body.beta.copy()
    framed = body.beta.copy()
    offset[structure.groups["offset"][0]] += getattr(structure, "mirror", 1) * (
        sensor.value or 0.0
    )
    framed[frame] = evidence.findings[0].beta[frame]
    before = structure.predict(probes, body.beta)
    turned = structure.predict(probes, framed)
    apart = np.linalg.norm(turned - structure.predict(probes, offset))
    return bool(apart <= _ALIKE * np.linalg.norm(turned - before) + 1e-12)


def _all_larger(evidence: Evidence, by_name: dict[str, Cause]) -> bool:
    """Whether all links are longer by one share, or the sensor's scale says so."""
    lengths = evidence.rows.body.structure.groups.get("length", ())
    scale = by_name.get("scale")
    if scale is not None and scale.interval is not None and len(lengths):
        return True
    shares = []
    for name, k in zip(evidence.rows.model.about.joint_names, lengths, strict=False):
        cause = by_name.get(f"length:{name}")
        if cause is None or cause.interval is None:
            return False
        shares.append(np.array(cause.interval) / evidence.prior.beta[k])
    return bool(shares) and bool(np.max(shares, axis=0)[0] <= np.min(shares, axis=0)[1])
