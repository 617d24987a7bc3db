"""A body in words: "elbow: +0.43 ± 0.02 deg, gain 1.0003"."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from .structure import Structure

LEAST_BEND = 5e-6
"""Largest bend [rad] of a joint that is not told."""

POSTURES = 500
"""Postures of which the largest bend is told."""


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
        *_of_joints(structure, beta, half, structure.bends(postures, beta)),
        *_of_gravity(structure, beta, half),
        *_of_sensor(structure, beta, half),
    )


def _of_joints(structure: Structure, beta: Array, half: Array, bends: Array) -> Iterator[str]:
    """What each joint has of its own, `half` (d,) half widths of intervals, `bends` (c, n)."""
    directions = dict(zip(structure.joint_names, structure.directions, strict=True))
    joints: dict[str, dict[tuple[str, str], list[int]]] = {}
    for i, (group, joint, _, unit) in enumerate(structure.labels):
        if joint and half[i] > 0:
            kind = "elastic" if group in structure.bending else group.partition(".")[0]
            joints.setdefault(joint, {}).setdefault((kind, unit), []).append(i)
    largest = dict(zip(structure.chain_names, np.abs(bends).max(axis=1), strict=True))
    for joint, kinds in joints.items():
        parts = []
        for (kind, unit), indices in kinds.items():
            if kind == "elastic":
                if largest[joint] >= LEAST_BEND:
                    parts.append(f"bends by up to {1e3 * largest[joint]:.2f} mrad under load")
            elif kind != "curve":
                parts.append(_of_kind(structure, kind, unit, beta[indices], half[indices], indices))
        if directions.get(joint, 1) < 0:
            parts.append("turns against its log")
        if parts:
            yield f"{joint}: {', '.join(parts)}"
    for joint, kinds in joints.items():
        for (kind, _), indices in kinds.items():
            if kind == "curve":
                rms = float(np.linalg.norm(beta[indices])) / np.sqrt(2)
                yield f"joint curve of {joint} {1e3 * rms:.2f} mrad rms"


def _of_kind(
    structure: Structure, kind: str, unit: str, value: Array, half: Array, indices: list[int]
) -> str:
    """Parameters of one kind and unit of a joint, with half widths of their intervals."""
    first = float(value[0])
    width = float(np.sqrt((half**2).mean()))
    away = value - structure.neutral()[indices]
    if kind == "offset" and unit == "rad" and width >= np.pi:
        return "offset not told apart from the tool's turn"
    if kind == "offset":
        return _interval(float(away[0]), width, unit, "+")
    if kind == "gain":
        return f"gain {first:.{min(_digits(width), 8)}f}"
    if kind == "coupling":
        return f"follows its neighbour's motor by {_interval(100.0 * first, 100.0 * width, '%')}"
    if kind == "length":
        return f"length {_interval(first, width, unit)}"
    moved = "origin moved" if unit == "m" else "turned"
    return f"{moved} {_interval(float(np.linalg.norm(away)), width, unit)}"


def _of_gravity(structure: Structure, beta: Array, half: Array) -> Iterator[str]:
    """How far gravity points from where the drawing says, if that is more than rows leave open."""
    angles = structure.groups.get("gravity", np.zeros(0, dtype=np.intp))
    if not half[angles].any():
        return
    tilt = float(np.linalg.norm(beta[angles]))
    width = float(np.linalg.norm(half[angles]) / np.sqrt(2))
    if tilt > width:
        yield f"gravity points {_interval(tilt, width, 'rad')} away from the drawing's down"


def _interval(value: float, half: float, unit: str, sign: str = "") -> str:
    """A value with its interval, angles in degrees and metres in mm."""
    if unit == "rad":
        value, half = np.degrees((value + np.pi) % (2 * np.pi) - np.pi), np.degrees(half)
    if unit == "m":
        value, half = 1e3 * value, 1e3 * half
    shown, digits = {"rad": " deg", "m": " mm", "1": ""}.get(unit, f" {unit}"), _digits(half)
    return f"{value:{sign}.{digits}f} ± {half:.{digits}f}{shown}"


def _digits(width: float) -> int:
    """Decimals that show an interval of this half width with two digits."""
    return int(np.clip(1 - np.floor(np.log10(width)), 0, 10)) if width > 0 else 4


def _of_sensor(structure: Structure, beta: Array, half: Array) -> Iterator[str]:
    """What is at the tip, and the lens; `SensorPose` says where a sensor in space stands."""
    tool, lens = structure.groups.get("tool"), structure.groups["lens"]
    if tool is not None and half[tool].any():
        shown = ", ".join(f"{1e3 * v:.1f}" for v in beta[tool])
        width = 1e3 * float(np.sqrt((half[tool] ** 2).mean()))
        yield f"tool ({shown}) ± {width:.2f} mm from the tip"
    if half[lens].any():
        labels = structure.labels
        own = (f"{labels[k].name[5:]} {_interval(beta[k], half[k], labels[k].unit)}" for k in lens)
        yield f"lens: {', '.join(own)}"
