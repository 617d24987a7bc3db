"""Causes from an explanation: each freed parameter that is clearly away from where it was."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..body.structure import Indices, Label, Structure
from ..common.arrays import Array
from ..common.wording import for_people
from ..model.alignment import Alignment
from .cause import AS_ONE, Cause
from .members import FRAME, parts_of

if TYPE_CHECKING:
    from .comparison import Comparison
    from .explain import Explanation

SIGNIFICANT = 2.6
"""Standard deviations from which a parameter is said to have changed."""

_VAGUE = math.radians(1.0)  # half an interval of a turn from which it is worth a word
_MATTERS = 0.05  # share of the largest displacement from which a cause is named


def of_parameters(comparison: Comparison, best: Explanation) -> list[Cause]:
    """Each freed parameter that is significantly away from where it was."""
    structure, old = comparison.reference.structure, comparison.belief.beta
    found: list[tuple[float, Cause]] = []
    every = np.flatnonzero(best.sd > 0)
    _, moves = structure.linearise(comparison.probes, best.beta, every)
    size = np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    for group in best.member.groups:
        if group in FRAME or (group == "view.scale" and comparison.reference.scale != 1.0):
            continue
        for name, ix in parts_of(structure, group):
            found += _of_group(comparison, best, name, ix, old, every, size)
    if best.member.framed:
        found += _of_sensor(comparison, best, old, every, size)
    if not comparison.reference.locked:
        found += _lost(comparison, best, old)
    found.sort(key=lambda pair: -pair[0])
    least = _MATTERS * max((moved for moved, _ in found if math.isfinite(moved)), default=0.0)
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
    clear = (deviation > 0) & (np.abs(change) > SIGNIFICANT * deviation)
    if _kind(group) in AS_ONE:
        if not clear.any():
            return []
        moved = float(np.linalg.norm(change * size[np.searchsorted(every, ix)]))
        largest = int(np.argmax(np.abs(change) * clear))
        return [(moved, _summed(structure, group, int(ix[largest]), change, deviation, largest))]
    found = []
    for k in np.flatnonzero(clear):
        label = structure.label(int(ix[k]))
        moved = abs(float(change[k])) * float(size[np.searchsorted(every, ix[k])])
        found.append((moved, single(label, old[ix[k]], change[k], deviation[k])))
    return found


def _summed(
    structure: Structure, group: str, index: int, change: Array, deviation: Array, largest: int
) -> Cause:
    label = structure.label(index)
    value, half = float(change[largest]), 1.96 * float(deviation[largest])
    size = math.degrees(float(np.abs(change).max()))
    words = AS_ONE[_kind(group)].format(joint=label.joint, size=size)
    if group == "view.scale":
        words += f" by {100 * math.expm1(value):+.3g} %"
    name = f"{_kind(group)}:{label.joint}" if label.joint else group.removeprefix("view.")
    return Cause(name, group, value, (value - half, value + half), label.unit, words)


def _kind(group: str) -> str:
    """A group's name, of a joint's own curve that of all curves."""
    return "curve" if group.startswith("curve.") else group


def single(label: Label, old: float, change: float, sd: float) -> Cause:
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
    turn, shift = (structure.groups[g] for g in FRAME)
    both = np.concatenate([turn, shift])
    change, deviation = (best.beta - old)[both], best.deviation[both]
    mirrored = comparison.reference.mirrored
    new = mirrored or comparison.reference.scale != 1.0
    if not new and not (np.abs(change) > SIGNIFICANT * deviation).any():
        return []
    before, after = _seen_before_and_after(comparison, best.beta)
    if before.shape[1] == 3:
        value, motion = _rigid_motion(before, after, comparison.unit_seen)
        half = 1.96 * float(np.linalg.norm(deviation[: len(turn)]))
    else:
        value, half = float(change[0]), 1.96 * float(deviation[0])
        value = (value + math.pi) % (2 * math.pi) - math.pi
        motion = Alignment.between(before, after).words(comparison.unit_seen)
    words = f"the sensor's frame moved: {motion}"
    if half > _VAGUE:
        words += f" (the turn to ± {math.degrees(half):.2g} deg)"
    where = np.searchsorted(every, both)
    moved = math.inf if new else float(np.linalg.norm(change * size[where]))
    cause = Cause("sensor", "view.rotation", value, (value - half, value + half), "rad", words)
    return [(moved, cause)]


def frame_between(comparison: Comparison, beta: Array) -> Alignment:
    """The sensor's new frame as an affine map of the old one."""
    places = slice(comparison.belief.structure.blocks[0])
    before, after = _seen_before_and_after(comparison, beta)
    return Alignment.between(before[:, places], after[:, places])


def _seen_before_and_after(comparison: Comparison, beta: Array) -> tuple[Array, Array]:
    """Probes (p, m) as the sensor saw them before and sees them now, the arm unchanged."""
    structure, old = comparison.reference.structure, comparison.body
    mixed = comparison.belief.beta.copy()
    for name, ix in structure.groups.items():
        if name.startswith("view.") or name == "lens":
            mixed[ix] = beta[ix]
    before = old.structure.predict(comparison.probes, old.beta)
    return np.asarray(before), np.asarray(structure.predict(comparison.probes, mixed))


def _rigid_motion(before: Array, after: Array, unit: str) -> tuple[float, str]:
    """Angle [rad] of the rotation that takes positions (p, 3) over, and the motion in words."""
    from scipy.spatial.transform import Rotation

    middle = before.mean(axis=0)
    turn, _ = Rotation.align_vectors(after - after.mean(axis=0), before - middle)
    angle = float(turn.magnitude())
    factor, name = for_people(unit)
    shift = factor * (after.mean(axis=0) - middle)
    axis = np.round(turn.as_rotvec() / max(angle, 1e-300), 2) + 0.0
    about = ", ".join(f"{part:.2f}" for part in axis.tolist())
    moved = ", ".join(f"{part:.4g}" for part in shift)
    return angle, (
        f"turned {math.degrees(angle):.3g} deg about ({about}), shifted by ({moved}) {name} at "
        "the middle of the workspace"
    )


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
