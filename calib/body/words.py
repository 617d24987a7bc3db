"""A body in words: "elbow: +0.43 ± 0.02 deg, gain 1.0003"."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from .structure import Structure

POSTURES = 500
"""Postures of which the largest bend is told."""

LEAST_BEND = 5e-6
"""Largest bend [rad] of a joint that is not told."""

_DIGITS_OF_GAIN = 8  # a gain is not shown with more decimals


def words_of(
    structure: Structure, beta: Array, sd: Array, postures: Array | None = None
) -> tuple[str, ...]:
    """Lines that say the parameters; intervals are 95 %.

    sd : (d,), zero where nothing was fitted
    postures : (n, dof) [rad or m], all over the range in which loads bend the joints; by default
        all over a turn
    """
    half = 1.96 * sd
    if postures is None:
        rng = np.random.default_rng(0)
        postures = np.pi * rng.uniform(-1.0, 1.0, (POSTURES, structure.dof))
    return (
        *_of_joints(structure, beta, half),
        *_of_gravity(structure, beta, half, postures),
        *_of_sensor(structure, beta, half),
    )


def _of_joints(structure: Structure, beta: Array, half: Array) -> Iterator[str]:
    """What each joint has of its own, `half` (d,) half widths of intervals."""
    away = beta - structure.neutral()
    kinds: dict[tuple[str, str, str], list[int]] = defaultdict(list)
    for index in np.flatnonzero(half).tolist():
        label = structure.labels[index]
        group = label.group.partition(".")[0]
        if label.joint is not None and group not in structure.loads:
            kinds[label.joint, group, label.unit].append(index)
    words: dict[str, list[str]] = defaultdict(list)
    curves: list[str] = []
    for (joint, group, unit), indices in kinds.items():
        size = float(np.linalg.norm(away[indices]))
        if group == "curve":
            rms = 1e3 * size / np.sqrt(2)
            curves.append(f"joint curve of {joint} {rms:.2f} mrad rms")
            continue
        width = float(np.sqrt((half[indices] ** 2).mean()))
        value = float(beta[indices[0]])
        if group == "offset":
            text = _interval(float(away[indices[0]]), width, unit, "+")
            if unit == "rad" and width >= np.pi:
                text = "offset not told apart from the tool's turn"
        elif group == "gain":
            digits = min(_digits(width), _DIGITS_OF_GAIN)
            text = f"gain {value:.{digits}f}"
        elif group == "coupling":
            moved = _interval(1e3 * value, 1e3 * width, "1", "+")
            text = f"moves by {moved} mrad for each rad of the joint before it"
        elif group == "length":
            text = f"length {_interval(value, width, unit)}"
        else:
            verb = "origin moved" if unit == "m" else "turned"
            text = f"{verb} {_interval(size, width, unit)}"
        words[joint].append(text)
    directions = dict(
        zip(structure.joint_names, structure.directions, strict=True)
    )
    for joint in dict.fromkeys(joint for joint, _, _ in kinds):
        if directions.get(joint, 1) < 0:
            words[joint].append("turns against its log")
        if words[joint]:
            yield f"{joint}: {', '.join(words[joint])}"
    yield from curves


def _of_gravity(
    structure: Structure, beta: Array, half: Array, postures: Array
) -> Iterator[str]:
    """How far loads bend the joints at most, and where gravity points, if the drawing errs."""
    fitted = [
        index for block in structure.loads for index in structure.groups[block]
    ]
    if not half[fitted].any():
        return
    largest = np.abs(structure.bends(postures, beta)).max(axis=1)
    for joint, bend in zip(
        structure.chain_names, largest.tolist(), strict=True
    ):
        if bend >= LEAST_BEND:
            yield f"{joint}: bends by up to {1e3 * bend:.2f} mrad under load"
    angles = structure.groups.get("gravity", np.zeros(0, dtype=np.intp))
    tilt = float(np.linalg.norm(beta[angles]))
    width = float(np.linalg.norm(half[angles]) / np.sqrt(2))
    if half[angles].any() and tilt > width:
        yield f"gravity points {_interval(tilt, width, 'rad')} away from the drawing's down"


def _interval(value: float, half: float, unit: str, sign: str = "") -> str:
    """A value with its interval, angles in degrees and metres in mm."""
    suffix = "" if unit == "1" else f" {unit}"
    if unit == "rad":
        value = float(np.degrees((value + np.pi) % (2 * np.pi) - np.pi))
        half = float(np.degrees(half))
        suffix = " deg"
    elif unit == "m":
        value *= 1e3
        half *= 1e3
        suffix = " mm"
    digits = _digits(half)
    return f"{value:{sign}.{digits}f} ± {half:.{digits}f}{suffix}"


def _digits(width: float) -> int:
    """Decimals that show an interval of this half width with two digits."""
    if width <= 0:
        return 4
    return int(np.clip(1 - np.floor(np.log10(width)), 0, 10))


def _of_sensor(structure: Structure, beta: Array, half: Array) -> Iterator[str]:
    """What is at the tip, and the lens; `SensorPose` says where a sensor in space stands."""
    for group, place in (
        ("tool", "the tip"),
        ("marker", "the first sensor's marker"),
    ):
        index = structure.groups.get(group)
        if index is not None and half[index].any():
            # a value that rounds to zero has no sign
            shift = ", ".join(
                f"{round(1e3 * v, 1) + 0.0:.1f}" for v in beta[index]
            )
            width = 1e3 * float(np.sqrt((half[index] ** 2).mean()))
            yield f"{group} ({shift}) ± {width:.2f} mm from {place}"
    lens = structure.groups["lens"]
    if half[lens].any():
        words: list[str] = []
        for k in lens:
            label = structure.labels[k]
            name = label.name.rpartition("lens.")[2]
            words.append(
                f"{name} {_interval(float(beta[k]), half[k], label.unit)}"
            )
        yield f"lens: {', '.join(words)}"
