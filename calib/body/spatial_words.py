"""A spatial body in words: joint origins, tool, camera, elasticity and joint curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from .curves import curve_rms

if TYPE_CHECKING:
    from .spatial import SpatialStructure


def words(structure: SpatialStructure, beta: Array, sd: Array) -> tuple[str, ...]:
    """Lines that say the parameters; the intervals are 95 %."""
    lines: list[str] = []
    groups, layout = structure.groups, structure.layout
    for i, name in enumerate(structure.chain_names):
        parts: list[str] = []
        if name in structure.joint_names:
            k = structure.joint_names.index(name)
            at = groups["offset"][k]
            if sd[at] > 0:
                factor, unit = (180 / np.pi, "deg") if structure.revolute[k] else (1e3, "mm")
                parts.append(f"{factor * beta[at]:+.3f} ± {factor * 1.96 * sd[at]:.3f} {unit}")
            elif sd[groups["offset"]].any() and structure.view != "base" and k == 0:
                parts.append("offset zero by convention: the frame's turn is the same")
            at = groups["gain"][k]
            if sd[at] > 0:
                parts.append(f"gain {beta[at]:.6f}")
        shifts, turns = layout.shifts[i], layout.turns[i]
        if sd[shifts].any():
            parts.append(
                f"origin moved {1e3 * _length(beta[shifts]):.2f} ± "
                f"{1e3 * 1.96 * _rms(sd[shifts]):.2f} mm"
            )
        if sd[turns].any():
            parts.append(
                f"turned {np.degrees(_length(beta[turns])):.3f} ± "
                f"{np.degrees(1.96 * _rms(sd[turns])):.3f} deg"
            )
        if len(groups["elastic"]) and sd[groups["elastic"][i]] > 0:
            bend = 1e3 * beta[groups["elastic"][i]]
            parts.append(f"bends {bend:+.2f} mrad when stretched")
        if parts:
            lines.append(f"{name}: {', '.join(parts)}")
    for k, name in enumerate(structure.joint_names):
        curve = groups[f"curve.{k}"]
        if len(curve) and sd[curve].any():
            lines.append(f"joint curve of {name} {1e3 * curve_rms(beta[curve]):.2f} mrad rms")
    tool = groups["tool"]
    if sd[tool].any():
        shown = ", ".join(f"{1e3 * v:.1f}" for v in beta[tool])
        lines.append(f"tool ({shown}) ± {1e3 * 1.96 * _rms(sd[tool]):.2f} mm from the tip")
    if structure.camera:  # `Body.describe` says where it stands
        f, u, v, k1 = beta[groups["lens"]]
        spread = 1.96 * sd[groups["lens"][0]]
        f, known = (f"{f:.1f} ± {spread:.1f}", "") if spread > 0 else (f"{f:.1f}", " (given)")
        lines.append(f"lens f {f} px, centre ({u:.1f}, {v:.1f}) px, k1 {k1:.4f}{known}")
    return tuple(lines)


def _length(vector: Array) -> float:
    return float(np.linalg.norm(vector))


def _rms(sd: Array) -> float:
    return float(np.sqrt((sd**2).mean()))
