"""A body in words: "elbow: +0.43 ± 0.02 deg, gain 1.0003"."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..common.arrays import Array
from .curves import curve_rms
from .planar import PlanarStructure
from .spatial import SpatialStructure
from .structure import Structure


def words_of(structure: Structure, beta: Array, sd: Array) -> tuple[str, ...]:
    """Lines that say the parameters; `sd` (d,) is zero where nothing was fitted.

    Intervals are 95 %.
    """
    lines = list(_of_joints(structure, beta, 1.96 * sd))
    if isinstance(structure, PlanarStructure):
        lines += _of_plane(structure, beta, 1.96 * sd)
    if isinstance(structure, SpatialStructure):
        lines += _of_space(structure, beta, 1.96 * sd)
    return tuple(lines)


def _of_joints(structure: Structure, beta: Array, half: Array) -> Iterator[str]:
    """What each joint has of its own, `half` (d,) half widths of intervals."""
    away, labels = beta - structure.neutral(), structure.labels
    curves = []
    for joint in dict.fromkeys(label.joint for label in labels if label.joint):
        own: dict[tuple[str, str], list[int]] = {}
        for i, label in enumerate(labels):
            if label.joint == joint and half[i] > 0:
                own.setdefault((label.group.partition(".")[0], label.unit), []).append(i)
        parts = []
        for (group, unit), at in own.items():
            size, width = float(np.linalg.norm(away[at])), float(np.sqrt((half[at] ** 2).mean()))
            if group == "offset" and unit == "rad" and width >= np.pi:
                parts.append("offset not told apart from the tool's turn")
            elif group == "offset":
                parts.append(_interval(float(away[at[0]]), width, unit, "+"))
            elif group == "length":
                parts.append(f"length {_interval(float(beta[at[0]]), width, unit)}")
            elif group == "gain":
                parts.append(f"gain {beta[at[0]]:.{min(_digits(width), 8)}f}")
            elif group == "placement":
                moved = "turned" if unit == "rad" else "origin moved"
                parts.append(f"{moved} {_interval(size, width, unit)}")
            elif group == "elastic":
                parts.append(f"bends by {1e3 * size:.2f} mrad under load")
            elif group == "curve":
                curves.append(f"joint curve of {joint} {1e3 * curve_rms(beta[at]):.2f} mrad rms")
        if joint in structure.joint_names:
            against = structure.directions[structure.joint_names.index(joint)] < 0
            parts += ["turns against its log"] * against
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


def _of_plane(structure: PlanarStructure, beta: Array, half: Array) -> Iterator[str]:
    """The sensor of a planar arm."""
    if structure.mirror != (structure.nominal.mirror if structure.nominal else 1):
        yield "the sensor sees the plane mirrored"
    radial = structure.groups["lens"][0]
    if half[radial] > 0:
        yield (
            f"lens bends by {100 * beta[radial]:+.2f} ± {100 * half[radial]:.2f} % at "
            f"{structure.measurement.size_of_lens:.3g} {structure.unit} from its centre"
        )


def _of_space(structure: SpatialStructure, beta: Array, half: Array) -> Iterator[str]:
    """The tool of an arm in space, and the lens of its camera; `describe` says where it stands."""
    tool, lens = structure.groups["tool"], structure.groups["lens"]
    if half[tool].any():
        shown = ", ".join(f"{1e3 * v:.1f}" for v in beta[tool])
        width = 1e3 * float(np.sqrt((half[tool] ** 2).mean()))
        yield f"tool ({shown}) ± {width:.2f} mm from the tip"
    if structure.camera:
        f, u, v, k1 = beta[lens]
        focal = f"{f:.1f} ± {half[lens[0]]:.1f}" if half[lens[0]] > 0 else f"{f:.1f} (given)"
        yield f"lens f {focal} px, centre ({u:.1f}, {v:.1f}) px, k1 {k1:.4f}"
