"""Causes: what changed between a model and a log, in numbers and in words.

`check` and `adapt` ask here with the same comparison, so that both say the same of one log.
What a log cannot tell apart is said with the cause that was named: a sensor that was turned about
the first joint's axis and that joint's offset are the same; so are a sensor that shows all larger
and links that are all longer.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.wording import for_people
from ..model.alignment import Alignment
from ..samples.diagnosis import unit_hint
from .cause import AS_ONE, Cause
from .comparison import Comparison
from .explain import Explanation, simplest
from .hypotheses import FRAME, NOTHING, parts_of
from .score import fired
from .settings import CREEP

_SIGNIFICANT = 2.6  # standard deviations from which a parameter is said to have changed
_NOISIER = 1.5  # noise over the usual one from which it is worth a word
_ALIKE = 0.15  # share of a displacement that may differ between two words for it
_VAGUE = math.radians(1.0)  # half an interval of a turn from which it is worth a word
_MATTERS = 0.05  # share of the largest displacement from which a cause is named
_WHICH = "are the same to this log: give `cause='joints'` or `cause='sensor'` if you know which"


def find_causes(found: Comparison, drifted: bool) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Causes of a log, and what else must be said of them.

    drifted : whether something fired; otherwise more noise is the only cause there may be
    Returns causes : the largest first
    Returns notes : directions that the log cannot tell apart
    """
    if drifted and not found.explained:
        return (Cause("unknown", "", found.why_not()),), ()
    causes: list[Cause] = []
    notes: list[str] = []
    if drifted:
        causes += _of_frame(found)
        best = simplest(found.explanations)
        if found.changed and best.hypothesis != NOTHING:
            causes += _of_parameters(found, best)
        elif found.changed and best.waves > CREEP:
            words = "the joints have waves that the model does not know: gears, or their sensors"
            causes.append(Cause("curve", "curve", words))
        elif not causes:
            causes += _of_tests(found)
        named = tuple(causes)
        for same, told in (_same_as_first_joint(found, named), _same_as_scale(found, named)):
            causes += same
            notes += told
        if not causes:
            words = "no single change of the sensor, a joint or a link explains it"
            causes.append(Cause("unknown", "", words))
    noise, usual, noisy = found.tested.noise, found.tested.usual, found.tested.noisy
    if noisy is not None and not drifted:
        causes.append(_noisy_encoder(found, *noisy))
    if drifted and found.changed:  # a large change is not linear: what the best one leaves
        noise = min(noise, found.explanations[0].noise * float(found.reference.sizes[0]))
    if noise >= _NOISIER * usual:
        factor, unit = for_people(found.unit_seen)
        words = f"the scatter is {factor * noise:.3g} {unit} per axis, {noise / usual:.2g} times "
        causes.append(Cause("noise", "noise", words + "the usual", noise, None, found.unit_seen))
    return tuple(causes), tuple(notes)


def causes_of_maps(found: Comparison) -> tuple[Cause, ...]:
    """What is told of maps alone, whose rows are compared with their bound."""
    if found.score <= 1.0:
        return ()
    words = f"{100 * found.beyond:.0f} % of the rows are beyond the maps' bound"
    return (Cause("unknown", "maps", words),)


def _noisy_encoder(found: Comparison, joint: int, sd: float) -> Cause:
    """One joint's encoder, or what it drives, that is noisy."""
    name, turns = found.model.about.joint_names[joint], found.model.about.revolute[joint]
    size = f"{math.degrees(sd):.2g} deg" if turns else f"{1e3 * sd:.2g} mm"
    words = f"{name} is noisy, by {size}: its encoder, or play; no calibration mends that"
    return Cause(f"noise:{name}", "noise", words, sd, None, "rad" if turns else "m")


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


def _of_tests(found: Comparison) -> list[Cause]:
    """The most telling group that fired, where no member is clearly better than no change."""
    structure, above = found.body.structure, fired(found.tested.groups)
    if found.cause == "sensor":
        above = tuple(g for g in above if g.name.startswith("sensor") or g.name == "lens")
    if not above:
        return []
    best = above[0]
    if best.name.startswith("sensor") or best.name == "lens":
        value, half = float(best.estimate[0]), 1.96 * float(best.deviation[0])
        label = structure.label(int(best.indices[0]))
        words = "the sensor's frame moved a little"
        if label.unit == "rad":
            words = f"the sensor turned by {math.degrees(value):.3g} ± {math.degrees(half):.2g} deg"
        return [Cause.measured("sensor", label.group, words, value, half, label.unit)]
    causes = []
    for index, value, sd in zip(best.indices, best.estimate, best.deviation, strict=True):
        label = structure.label(int(index))
        own = label.joint is not None and abs(value) > _SIGNIFICANT * sd
        if own and label.group in ("offset", "length", "gain", "placement"):
            causes.append(Cause.of_parameter(label, found.body.beta[index], value, sd))
    return causes


def _of_parameters(found: Comparison, best: Explanation) -> list[Cause]:
    """Each freed parameter that is clearly away from where it was, the largest effect first."""
    structure, old = found.reference.structure, found.belief.beta
    change = best.beta - old
    clear = (best.deviation > 0) & (np.abs(change) > _SIGNIFICANT * best.deviation)
    size = np.zeros(len(old))  # root mean square displacement by one of each parameter
    free = np.flatnonzero(best.sd > 0)
    _, moves = structure.linearise(found.probes, best.beta, free)
    size[free] = np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    causes: list[tuple[float, Cause]] = []
    for group in best.hypothesis.groups:
        if group in FRAME or (group == "view.scale" and found.reference.scale != 1.0):
            continue
        for name, every in parts_of(structure, group):
            ix = every[clear[every]]
            kind = "curve" if name.startswith("curve.") else name
            if kind not in AS_ONE:
                causes += [
                    (
                        abs(float(change[k])) * float(size[k]),
                        Cause.of_parameter(
                            structure.label(int(k)), old[k], change[k], best.deviation[k]
                        ),
                    )
                    for k in ix
                ]
            elif len(ix):
                most = int(ix[np.argmax(np.abs(change[ix]))])
                label, value = structure.label(most), float(change[most])
                bent = math.degrees(float(np.abs(change[every]).max()))
                words = AS_ONE[kind].format(joint=label.joint, size=bent)
                if name == "view.scale":
                    words += f" by {100 * math.expm1(value):+.3g} %"
                told = f"{kind}:{label.joint}" if label.joint else name.removeprefix("view.")
                half = 1.96 * float(best.deviation[most])
                cause = Cause.measured(told, name, words, value, half, label.unit)
                causes.append((float(np.linalg.norm(change[every] * size[every])), cause))
    if best.hypothesis.framed:
        causes += _of_sensor(found, best, change, clear, size)
    if not found.reference.locked:  # joints that moved the tip and no longer do
        before, after = (
            np.sqrt((structure.slope(found.probes, b) ** 2).sum(axis=1).mean(axis=0))
            for b in (old, best.beta)
        )
        scale = min(float(np.sum(after) / max(float(np.sum(before)), 1e-300)), 1.0)
        gone = np.flatnonzero(after < 0.02 * before * scale)
        causes += [(math.inf, _lost(found.model.about.joint_names[k])) for k in gone]
    causes.sort(key=lambda pair: -pair[0])
    least = _MATTERS * max((moved for moved, _ in causes if math.isfinite(moved)), default=0.0)
    return [cause for moved, cause in causes if moved >= least]


def _of_sensor(
    found: Comparison, best: Explanation, change: Array, clear: NDArray[np.bool_], size: Array
) -> list[tuple[float, Cause]]:
    """The sensor's frame as one cause, its rotation as the number; the displacement by it."""
    turn, shift = (found.reference.structure.groups[g] for g in FRAME)
    both = np.concatenate([turn, shift])
    new = found.reference.mirrored or found.reference.scale != 1.0
    if not new and not clear[both].any():
        return []
    before, after = _seen_before_and_after(found, best.beta)
    if before.shape[1] == 3:
        half = 1.96 * float(np.linalg.norm(best.deviation[turn]))
        value, motion = _rigid_motion(before, after, found.unit_seen)
    else:
        half = 1.96 * float(best.deviation[turn[0]])
        value = (float(change[turn[0]]) + math.pi) % (2 * math.pi) - math.pi
        motion = Alignment.between(before, after).words(found.unit_seen)
    words = f"the sensor's frame moved: {motion}"
    if half > _VAGUE:
        words += f" (the turn to ± {math.degrees(half):.2g} deg)"
    moved = math.inf if new else float(np.linalg.norm(change[both] * size[both]))
    return [(moved, Cause.measured("sensor", "view.rotation", words, value, half, "rad"))]


def frame_between(found: Comparison, beta: Array) -> Alignment:
    """The sensor's new frame, of parameters (d,), as an affine map of the old one."""
    places = slice(found.belief.structure.blocks[0])
    before, after = _seen_before_and_after(found, beta)
    return Alignment.between(before[:, places], after[:, places])


def _seen_before_and_after(found: Comparison, beta: Array) -> tuple[Array, Array]:
    """Probes (p, m) as the sensor saw them before and sees them now, the arm unchanged."""
    structure, old = found.reference.structure, found.body
    mixed = found.belief.beta.copy()
    for name, ix in structure.groups.items():
        if name.startswith("view.") or name == "lens":
            mixed[ix] = beta[ix]
    before = old.structure.predict(found.probes, old.beta)
    return np.asarray(before), np.asarray(structure.predict(found.probes, mixed))


def _rigid_motion(before: Array, after: Array, unit: str) -> tuple[float, str]:
    """Angle [rad] of the rotation that takes positions (p, 3) over, and the motion in words."""
    from scipy.spatial.transform import Rotation

    middle = before.mean(axis=0)
    turn, _ = Rotation.align_vectors(after - after.mean(axis=0), before - middle)
    angle = float(turn.magnitude())
    factor, name = for_people(unit)
    axis = np.round(turn.as_rotvec() / max(angle, 1e-300), 2) + 0.0
    about = ", ".join(f"{part:.2f}" for part in axis.tolist())
    moved = ", ".join(f"{part:.4g}" for part in factor * (after.mean(axis=0) - middle))
    return angle, (
        f"turned {math.degrees(angle):.3g} deg about ({about}), shifted by ({moved}) {name} at "
        "the middle of the workspace"
    )


def _same_as_first_joint(
    found: Comparison, causes: tuple[Cause, ...]
) -> tuple[list[Cause], list[str]]:
    """The first joint's offset where a moved sensor says the same, and the other way round."""
    first = found.model.about.joint_names[0]
    named = {c.cause: c for c in causes}
    body, structure = found.body, found.body.structure
    offset = structure.groups.get("offset")
    if offset is None or not found.model.about.revolute[0] or "mirror" in named:
        return [], []
    words = f"an offset of the first joint and a turn of the sensor about its axis {_WHICH}"
    told = [words] if found.cause is None else []
    angle, sensor = named.get(f"offset:{first}"), named.get("sensor")
    if angle is not None:
        words = f"or the sensor turned by {math.degrees(angle.value or 0.0):.3g} deg about {first}"
        same = Cause("sensor", "view.rotation", words, angle.value, angle.interval, "rad")
        return ([same] if sensor is None else []), told
    if sensor is None or sensor.value is None or sensor.interval is None or sensor.unit != "rad":
        return [], []
    seen = structure.predict(found.probes, body.beta)
    moved, framed = body.beta.copy(), body.beta.copy()
    sense = int(getattr(structure, "mirror", 1))
    moved[offset[0]] += sense * sensor.value
    if found.changed:
        for group in FRAME:
            ix = structure.groups[group]
            framed[ix] = found.explanations[0].beta[ix]
    change = structure.predict(found.probes, framed) - seen
    gap = change - (structure.predict(found.probes, moved) - seen)
    if np.linalg.norm(gap) > _ALIKE * np.linalg.norm(change) + 1e-12:
        return [], []
    value = sense * sensor.value
    low, high = sorted(sense * end for end in sensor.interval)
    words = f"or {first} is off by {math.degrees(value):.3g} deg"
    return [Cause(f"offset:{first}", "offset", words, value, (low, high), "rad")], told


def _same_as_scale(found: Comparison, causes: tuple[Cause, ...]) -> tuple[list[Cause], list[str]]:
    """A sensor's scale where all links say the same, and the other way round."""
    about, body = found.model.about, found.belief
    lengths = body.structure.groups.get("length")
    if lengths is None or not all(about.revolute) or len(lengths) != len(about.joint_names):
        return [], []
    words = f"a sensor that shows all larger and links that are all longer {_WHICH}"
    told = [words] if found.cause is None else []
    if any(c.cause == "scale" and c.interval is not None for c in causes):
        return [], told
    longer = {
        c.cause: (c.interval[0], c.value, c.interval[1])
        for c in causes
        if c.group == "length" and c.value is not None and c.interval is not None
    }
    if len(longer) < len(about.joint_names):
        return [], []
    change = np.array([longer[f"length:{name}"] for name in about.joint_names])
    low, value, high = (change / body.beta[lengths][:, None]).T
    if low.max() > high.min():
        return [], []
    share = float(np.mean(value))
    words = f"or the sensor shows all {100 * abs(share):.3g} % "
    words += "larger" if share > 0 else "smaller"
    interval = math.log1p(low.max()), math.log1p(high.min())
    return [Cause("scale", "view.scale", words, math.log1p(share), interval, "1")], told
