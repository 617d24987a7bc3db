"""A body in words: "elbow: +0.43 ± 0.02 deg, gain 1.00030 ± 0.00012"."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from ..common.arrays import Array
from ..common.scale import TURN
from ..common.wording import for_people, number, with_interval
from .covariance import Z95
from .parameters import Indices
from .structure import Structure

POSTURES = 500
"""Postures among which the largest bend is reported."""

LEAST_BEND = 5e-6
"""A smaller bend [rad] of a joint is not reported."""


def words_of(
    structure: Structure,
    beta: Array,
    sd: Array,
    lower: Array | float,
    upper: Array | float,
) -> tuple[str, ...]:
    """Lines with the parameters and their 95 % intervals.

    sd : (d,), zero where nothing was fitted
    lower, upper : (dof,) [rad or m], range in which loads bend the joints
    """
    half = Z95 * sd
    rng = np.random.default_rng(0)
    postures = rng.uniform(lower, upper, (POSTURES, structure.dof))
    return (
        *_of_joints(structure, beta, half),
        *_of_loads(structure, beta, half, postures),
        *_of_sensor(structure, beta, half),
    )


def _of_joints(structure: Structure, beta: Array, half: Array) -> Iterator[str]:
    """Each joint's own parameters; `half` (d,) half widths of intervals."""
    deviation = beta - structure.neutral()
    deviation[structure.groups["offset"]] = structure.zeros(beta)
    kinds: dict[tuple[str, str, str], list[int]] = defaultdict(list)
    for index in np.flatnonzero(half).tolist():
        label = structure.labels[index]
        group = label.group.partition(".")[0]
        if label.joint is not None and group not in structure.loads:
            kinds[label.joint, group, label.unit].append(index)
    words: dict[str, list[str]] = defaultdict(list)
    for (joint, group, unit), indices in kinds.items():
        size = float(np.linalg.norm(deviation[indices]))
        square = (half[indices] ** 2).mean()
        width = float(np.sqrt(square))
        if group == "curve":
            text = f"joint curve {number(1e3 * size / np.sqrt(2))} mrad rms"
        elif group == "offset":
            text = _interval(float(deviation[indices[0]]), width, unit, "+")
            if unit == "rad" and width >= np.pi:
                text = "offset not told apart from the tool's turn"
        elif group == "placement":
            verb = "origin moved" if unit == "m" else "turned"
            text = f"{verb} {_interval(size, width, unit)}"
        else:
            value = float(beta[indices[0]])
            text = f"{group} {_interval(value, width, unit)}"
        words[joint].append(text)
    for joint, is_reversed in zip(
        structure.joint_names, structure.is_reversed, strict=True
    ):
        if is_reversed and joint in words:
            words[joint].append("turns against its log")
    for joint, texts in words.items():
        yield f"{joint}: {', '.join(texts)}"


def _of_loads(
    structure: Structure, beta: Array, half: Array, postures: Array
) -> Iterator[str]:
    """How far loads bend the joints at most."""
    groups = structure.groups
    if not any(half[groups[block]].any() for block in structure.loads):
        return
    bends = structure.bends(postures, beta)
    largest = np.abs(bends).max(axis=1)
    for joint, bend in zip(structure.chain_names, largest, strict=True):
        if bend >= LEAST_BEND:
            yield f"{joint}: bends by up to {number(1e3 * bend)} mrad under load"


def _interval(value: float, half: float, unit: str, sign: str = "") -> str:
    """A value with its interval, angles in degrees and metres in mm."""
    if unit == "rad":
        turn = (value + np.pi) % TURN
        value = turn - np.pi
    factor, name = for_people(unit)
    text = with_interval(factor * value, factor * half, sign)
    return text if unit == "1" else f"{text} {name}"


def _of_sensor(structure: Structure, beta: Array, half: Array) -> Iterator[str]:
    """What is at the tip, and the lens; `SensorPose` places a sensor in space."""
    for group, place in (
        ("tool", "the tip"),
        ("marker", "the first sensor's marker"),
    ):
        index: Sequence[int] | Indices = structure.groups.get(group, [])
        if half[index].any():
            mean = float((half[index] ** 2).mean())
            width = 1e3 * np.sqrt(mean)
            parts = [
                with_interval(1e3 * v, width).split(" ± ") for v in beta[index]
            ]
            shift = ", ".join(value for value, _ in parts)
            yield f"{group} ({shift}) ± {parts[0][1]} mm from {place}"
    words: list[str] = []
    for k in structure.groups["lens"]:
        if half[k]:
            label = structure.labels[k]
            name = label.name.rpartition("lens.")[2]
            value = float(beta[k])
            words.append(f"{name} {_interval(value, half[k], label.unit)}")
    if words:
        yield f"lens: {', '.join(words)}"
