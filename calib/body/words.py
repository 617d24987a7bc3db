"""A body in words: "elbow: +0.43 +- 0.02 deg, gain 1.0003", "camera tilted 19 deg".

Of a planar body its links, joints and view; of a spatial one joint origins, tool and lens.
"""

from __future__ import annotations

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
    if isinstance(structure, PlanarStructure):
        return _planar_words(structure, beta, sd)
    assert isinstance(structure, SpatialStructure)  # noqa: S101
    return _spatial_words(structure, beta, sd)


def _tilt_angle(structure: PlanarStructure, beta: Array) -> float:
    """Angle [rad] at which a sensor looks at the plane's middle, 0 from straight above.

    A circle around the mean position is seen as an ellipse whose axes have the ratio of the
    angle's cosine.  It is the angle of the line of sight, not of the optical axis: that one
    needs the focal length and the image's centre.
    """
    own = structure.seeing(beta)
    matrix, tilt = structure.measurement.matrix(own), own["view.tilt"]
    # Local scales at the middle of the workspace: the derivative of the homography there.
    middle = (structure.centre - own["view.shift"]) @ np.linalg.inv(matrix).T
    depth = 1.0 + middle @ tilt
    y = matrix @ middle / depth
    local = (matrix - np.outer(y, tilt)) / depth
    values = np.linalg.svd(local, compute_uv=False)
    return float(np.arccos(np.clip(values[1] / values[0], 0.0, 1.0)))


def _planar_words(structure: PlanarStructure, beta: Array, sd: Array) -> tuple[str, ...]:
    groups = structure.groups
    lines: list[str] = []
    for i, name in enumerate(structure.joint_names):
        parts: list[str] = []
        nominal = structure.nominal
        at = groups["offset"][i]
        if sd[at] > 0:
            value = beta[at] - (nominal.offsets[i] if nominal else 0.0)
            value = (value + np.pi) % (2 * np.pi) - np.pi
            what = "" if structure.revolute[i] else "direction "
            parts.append(f"{what}{np.degrees(value):+.2f} ± {np.degrees(1.96 * sd[at]):.2f} deg")
        at = groups["length"][i]
        if sd[at] > 0:
            unit = structure.label(int(at)).unit
            unit = "" if unit == "1" else f" {unit}"
            digits = _digits(1.96 * sd[at])
            parts.append(f"length {beta[at]:.{digits}f} ± {1.96 * sd[at]:.{digits}f}{unit}")
        at = groups["gain"][i]
        if sd[at] > 0:
            parts.append(f"gain {beta[at]:.{min(_digits(1.96 * sd[at]), 8)}f}")
        if structure.signs[i] < 0:
            parts.append("turns against its log")
        if parts:
            lines.append(f"{name}: {', '.join(parts)}")
        curve = groups[f"curve.{i}"]
        if sd[curve].any():
            rms = 1e3 * curve_rms(beta[curve])
            lines.append(f"joint curve of {name} {rms:.2f} mrad rms")
    if sd[groups["elastic"]].any():
        rms = 1e3 * float(np.sqrt((beta[groups["elastic"]] ** 2).mean()))
        lines.append(f"elasticity {rms:.2f} mrad rms")
    if structure.seen_as.tilted:
        lines.append(
            f"camera tilted {np.degrees(_tilt_angle(structure, beta)):.0f} deg (line of sight)"
        )
    if structure.mirror != (structure.nominal.mirror if structure.nominal else 1):
        lines.append("the sensor sees the plane mirrored")
    radial = groups["lens"][0]
    if sd[radial] > 0:
        lines.append(
            f"lens bends by {100 * beta[radial]:+.2f} ± {196 * sd[radial]:.2f} % at "
            f"{structure.measurement.size_of_lens:.3g} {structure.unit} from its centre"
        )
    return tuple(lines)


def _spatial_words(structure: SpatialStructure, beta: Array, sd: Array) -> tuple[str, ...]:
    lines: list[str] = []
    groups = structure.groups
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
        shifts, turns = structure.shifts[i], structure.turns[i]
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


def _digits(width: float) -> int:
    """Decimals that show an interval of this half width with two digits."""
    if not width > 0:
        return 4
    return int(np.clip(1 - np.floor(np.log10(width)), 0, 10))
