"""A body in words: "elbow: +0.43 ± 0.02 deg, gain 1.0003"."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from .structure import Structure


def words_of(structure: Structure, beta: Array, sd: Array) -> tuple[str, ...]:
    """Lines that say the parameters; `sd` (d,) is zero where nothing was fitted.

    Intervals are 95 %.
    """
    half = 1.96 * sd
    return (*_of_joints(structure, beta, half), *_of_sensor(structure, beta, half))


def _of_joints(structure: Structure, beta: Array, half: Array) -> Iterator[str]:
    """What each joint has of its own, `half` (d,) half widths of intervals."""
    away = beta - structure.neutral()
    ways = dict(zip(structure.joint_names, structure.directions, strict=True))
    joints: dict[str, dict[tuple[str, str], list[int]]] = {}
    for i, (group, joint, _, unit) in enumerate(structure.labels):
        if joint and half[i] > 0:
            own = joints.setdefault(joint, {})
            own.setdefault((group.partition(".")[0], unit), []).append(i)
    curves = []
    for joint, kinds in joints.items():
        parts = []
        for (group, unit), at in kinds.items():
            size, width = float(np.linalg.norm(away[at])), float(np.sqrt((half[at] ** 2).mean()))
            if group == "offset" and unit == "rad" and width >= np.pi:
                parts.append("offset not told apart from the tool's turn")
            elif group == "offset":
                parts.append(_interval(float(away[at[0]]), width, unit, "+"))
            elif group == "gain":
                parts.append(f"gain {beta[at[0]]:.{min(_digits(width), 8)}f}")
            elif group == "elastic":
                parts.append(f"bends by {1e3 * size:.2f} mrad under load")
            elif group == "curve":
                curves.append(f"joint curve of {joint} {1e3 * size / np.sqrt(2):.2f} mrad rms")
            else:
                moved = {"m": "origin moved", "rad": "turned"}[unit] if group != "length" else group
                value = float(beta[at[0]]) if group == "length" else size
                parts.append(f"{moved} {_interval(value, width, unit)}")
        parts += ["turns against its log"] * (ways.get(joint, 1) < 0)
        if parts:
            yield f"{joint}: {', '.join(parts)}"
    yield from curves


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
