"""A body in words: "elbow: +0.43 ± 0.02 deg, gain 1.0003"."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .structure import Structure

POSTURES = 500
"""Postures of which the largest bend is told."""

LEAST_BEND = 5e-6
"""Largest bend [rad] of a joint that is not told."""

_DIGITS_OF_GAIN = 8  # a gain is not shown with more decimals


@dataclass(frozen=True)
class _Kind:
    """Parameters of one kind of a joint, and their values."""

    group: str  # the block that they are of
    unit: str
    values: Array
    away: Array  # from the prior's mean
    half: Array  # half widths of 95 % intervals

    @property
    def size(self) -> float:
        """Length of their deviation."""
        return float(np.linalg.norm(self.away))

    @property
    def width(self) -> float:
        """Root mean square of the intervals' half widths."""
        return float(np.sqrt((self.half**2).mean()))

    def words(self) -> str:
        """Return what it says of the joint."""
        if self.group == "offset":
            if self.unit == "rad" and self.width >= np.pi:
                return "offset not told apart from the tool's turn"
            return _interval(float(self.away[0]), self.width, self.unit, "+")
        if self.group == "gain":
            digits = min(_digits(self.width), _DIGITS_OF_GAIN)
            return f"gain {self.values[0]:.{digits}f}"
        if self.group == "coupling":
            moved = _interval(1e3 * float(self.values[0]), 1e3 * self.width, "1", "+")
            return f"moves by {moved} mrad for each rad of the joint before it"
        if self.group == "length":
            return f"length {_interval(float(self.values[0]), self.width, self.unit)}"
        verb = "origin moved" if self.unit == "m" else "turned"
        return f"{verb} {_interval(self.size, self.width, self.unit)}"


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
    directions = dict(zip(structure.joint_names, structure.directions, strict=True))
    curves: list[str] = []
    for joint, kinds in _kinds_of_joints(structure, beta, half).items():
        words: list[str] = []
        for kind in kinds:
            if kind.group == "curve":
                rms = 1e3 * kind.size / np.sqrt(2)
                curves.append(f"joint curve of {joint} {rms:.2f} mrad rms")
            else:
                words.append(kind.words())
        if directions.get(joint, 1) < 0:
            words.append("turns against its log")
        if words:
            yield f"{joint}: {', '.join(words)}"
    yield from curves


def _kinds_of_joints(
    structure: Structure, beta: Array, half: Array
) -> Mapping[str, list[_Kind]]:
    """Fitted parameters by joint, those of one kind together."""
    indices: dict[str, dict[tuple[str, str], list[int]]] = defaultdict(
        lambda: defaultdict(list)
    )
    for index, label in enumerate(structure.labels):
        if label.joint is not None and half[index] > 0:
            group = label.group.partition(".")[0]
            if group in structure.bending:
                continue
            indices[label.joint][group, label.unit].append(index)
    away = beta - structure.neutral()
    return {
        joint: [
            _Kind(group, unit, beta[some], away[some], half[some])
            for (group, unit), some in groups.items()
        ]
        for joint, groups in indices.items()
    }


def _of_gravity(
    structure: Structure, beta: Array, half: Array, postures: Array
) -> Iterator[str]:
    """How far loads bend the joints at most, and where gravity points, if the drawing errs."""
    fitted = [index for block in structure.bending for index in structure.groups[block]]
    if not half[fitted].any():
        return
    largest = np.abs(structure.bends(postures, beta)).max(axis=1)
    for joint, bend in zip(structure.chain_names, largest.tolist(), strict=True):
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
    for group, place in (("tool", "the tip"), ("marker", "the first sensor's marker")):
        index = structure.groups.get(group)
        if index is not None and half[index].any():
            shift = ", ".join(f"{1e3 * value:.1f}" for value in beta[index])
            width = 1e3 * float(np.sqrt((half[index] ** 2).mean()))
            yield f"{group} ({shift}) ± {width:.2f} mm from {place}"
    lens = structure.groups["lens"]
    if half[lens].any():
        words: list[str] = []
        for k in lens:
            label = structure.labels[k]
            name = label.name.rpartition("lens.")[2]
            words.append(f"{name} {_interval(float(beta[k]), half[k], label.unit)}")
        yield f"lens: {', '.join(words)}"
