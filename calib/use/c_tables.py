"""C tables: the constants of a planar or spatial body, and how C source is filled with them.

The source itself is in the folder `c`: C99 that is also valid C++, without allocation and without
any library but ``math.h``.  Its names start with ``calib_``; `c_source` puts another prefix, and
numbers for words such as ``@unit@``; what stands between ``#if @word@`` and ``#endif`` is kept
where the word is true.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files

import numpy as np

from ..arm.motion import placements
from ..body.curves import HARMONICS
from ..body.parameters import Indices
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.spatial_view import LEAST_DEPTH
from ..body.structure import Structure
from ..common.arrays import Array

REAL, DOF = "calib_real", "CALIB_DOF"

_CHOICE = re.compile(r"^#if @(\w+)@\n((?:(?!#if @|#endif\n).*\n)*)#endif\n", re.MULTILINE)
_FUNCTIONS = re.compile(r"\b(cos|sin|sqrt|floor|fabs)\(")
_POSES, _POSE_CALM = 2, 1e-6  # steps towards a pose, and their damping


def source(*names: str) -> str:
    """Files of the C source, one after another."""
    folder = files(__package__) / "c"
    return "".join((folder / f"{name}.h").read_text(encoding="ascii") for name in names)


def c_source(text: str, words: Mapping[str, object], prefix: str, single: bool) -> str:
    """C source with its words filled in, names that start with `prefix`, and its precision."""
    while "#if @" in text:  # the innermost first
        text = _CHOICE.sub(lambda found: found[2] * bool(words[found[1]]), text)
    text = re.sub(r"@(\w+)@", lambda found: str(words[found.group(1)]), text)
    text = _FUNCTIONS.sub(r"\1f(", text) if single else text
    return text.replace("calib_", prefix).replace("CALIB_", prefix.upper())


def c_number(value: float, single: bool) -> str:
    """A C constant that reads back as the same number."""
    # nine digits tell any two floats apart, and a C literal needs a point or an exponent
    text = f"{np.float32(value):.9g}" if single else repr(float(value))
    text = text if any(c in text for c in ".en") else text + ".0"
    return text + "f" * single


def array(kind: str, name: str, sizes: Sequence[str], values: Array, single: bool) -> str:
    """A constant array of C, filled row by row."""
    flat = [c_number(v, single) for v in np.asarray(values, dtype=float).ravel()]
    lines = ["  " + ", ".join(flat[i : i + 4]) + "," for i in range(0, len(flat), 4)]
    shape = "".join(f"[{s}]" for s in sizes)
    if len(sizes) == 2:  # braces for each row, or compilers warn
        width = np.asarray(values).shape[1]
        rows = [", ".join(flat[i : i + width]) for i in range(0, len(flat), width)]
        lines = [f"  {{{row}}}," for row in rows]
    return f"static const {kind} {name}{shape} = {{\n" + "\n".join(lines) + "\n};\n"


def integers(name: str, size: str, values: Iterable[int]) -> str:
    """A constant array of int."""
    return f"static const int {name}[{size}] = {{{', '.join(str(int(v)) for v in values)}}};\n"


def curves_of(structure: Structure) -> dict[int, Indices]:
    """The parameters of each joint's curve; slides have none."""
    names = {k: f"curve.{k}" for k in range(structure.dof)}
    found = {k: structure.groups[name] for k, name in names.items() if name in structure.groups}
    return {k: curve for k, curve in found.items() if len(curve)}


def curves(structure: Structure, beta: Array, single: bool) -> str:
    """Cosines and sines of all joints, harmonic by harmonic."""
    waves = np.zeros((2, HARMONICS, structure.dof))
    for k, curve in curves_of(structure).items():
        waves[:, :, k] = beta[curve].reshape(2, HARMONICS)
    sizes = ["CALIB_HARMONICS", DOF]
    return "".join(
        array(REAL, f"calib_curve_{name}", sizes, wave, single)
        for name, wave in zip(("cos", "sin"), waves, strict=True)
    )


def planar(structure: PlanarStructure, beta: Array, single: bool) -> tuple[str, dict[str, object]]:
    """Tables of a planar body (signs, geometry, view, lens), and words of its source."""
    lay, own = structure.groups, structure.seeing(beta)
    view = np.concatenate([structure.measurement.matrix(own).ravel(), beta[4:8]])
    lens = np.concatenate([beta[8:11], structure.centre, [1.5 * structure.extent]])
    geometry = beta.copy()
    geometry[: lay["length"][0]] = 0.0  # the view and the lens have tables of their own
    words = {
        "gain": int(lay["gain"][0]),
        "offset": int(lay["offset"][0]),
        "length": int(lay["length"][0]),
        "elastic": int(lay["elastic"][0]) if len(lay["elastic"]) else 0,
        "curves": int(any(beta[ix].any() for ix in curves_of(structure).values())),
        "slide": c_number(structure.slide, single),
    }
    tables = (
        integers("calib_turns", DOF, structure.revolute)
        + array(REAL, "calib_sign", [DOF], np.asarray(structure.signs, dtype=float), single)
        + planar_arm("calib_beta", structure, geometry, single)
        + array(REAL, "calib_view", ["8"], view, single)
        + array(REAL, "calib_lens", ["6"], lens, single)
    )
    return tables, words


def shears(structure: PlanarStructure, beta: Array, single: bool) -> str:
    """How the view's linear part changes with its shear: two matrices, row by row."""
    turn = structure.measurement.turned(structure.seeing(beta))
    mirror = np.diag([1.0, float(structure.mirror)])
    both = [turn @ shear @ mirror for shear in (np.diag([1.0, -1.0]), np.eye(2)[::-1])]
    return array(REAL, "calib_shears", ["8"], np.ravel(both), single)


def planar_arm(name: str, structure: PlanarStructure, beta: Array, single: bool) -> str:
    """Parameters of one planar arm, the body's or the nominal one's, without curves."""
    groups = structure.groups
    short = int(max(groups["elastic"], default=groups["gain"][-1])) + 1
    return array(REAL, name, [str(short)], beta[:short], single)


def spatial(
    structure: SpatialStructure, beta: Array, single: bool
) -> tuple[str, dict[str, object]]:
    """Tables of a spatial body (chain, loads, curves, sensor), and words of its source."""
    chain, sensor = structure.chain, structure.sensor(beta)
    weighed = chain.masses if len(chain.masses) else np.zeros(chain.joints)
    middle = chain.centres - chain.points if len(chain.masses) else np.zeros((chain.joints, 3))
    gravity = np.asarray(structure.gravity) / structure.torque
    rows = "CALIB_CHAIN"
    tables = (
        "\n"
        + integers("calib_bends", rows, chain.revolute)
        + array(REAL, "calib_axis", [rows, "3"], chain.axes, single)
        + array(REAL, "calib_stride", [rows, "3"], placements(chain).strides, single)
        + array(REAL, "calib_coupling", [rows, DOF], chain.coupling, single)
        + array(REAL, "calib_bias", [rows], chain.bias, single)
        + array(REAL, "calib_mass", [rows], weighed, single)
        + array(REAL, "calib_centre", [rows, "3"], middle, single)
        + array(REAL, "calib_gravity", ["3"], gravity, single)
        + array(REAL, "calib_view", ["9"], sensor.scale * sensor.rotation, single)
        + array(REAL, "calib_aim", ["9"], sensor.rotation, single)
        + array(REAL, "calib_shift", ["3"], sensor.shift, single)
        + array(REAL, "calib_lens", ["4"], sensor.lens, single)
        + spatial_arm("calib_body", structure, beta, single)
    )
    words = {
        "law": structure.seen_as.source,
        "nearest": c_number(LEAST_DEPTH, single),
        "chain": chain.joints,
        "camera": structure.camera,
        "poses": _POSES,
        "pose_calm": c_number(_POSE_CALM, single),
        "lever": c_number(chain.reach, single),
        "half_lever": c_number(chain.reach / 2, single),
    }
    return tables, words


def spatial_arm(name: str, structure: SpatialStructure, beta: Array, single: bool) -> str:
    """The constant of one spatial arm, the body's or the nominal one's."""
    chain, groups = structure.chain, structure.groups
    moved = placements(chain, structure.deviations(beta))
    elastic = beta[groups["elastic"]] if len(groups["elastic"]) else np.zeros(chain.joints)
    parts = (
        beta[groups["gain"]],
        beta[groups["offset"]],
        elastic,
        moved.strides,
        moved.turns.reshape(-1, 9),
        moved.tip,
        moved.tip_turn.ravel(),
    )
    bent = any(beta[curve].any() for curve in curves_of(structure).values())
    words = [_braces(np.asarray(part), single) for part in parts]
    flags = f"{int(bent)}, {int(elastic.any())}"
    return f"\nstatic const calib_arm {name} = {{\n  " + ",\n  ".join([*words, flags]) + "\n};\n"


def _braces(values: Array, single: bool) -> str:
    """Numbers in the braces of a C constant, row by row."""
    if values.ndim == 2:
        return "{" + ",\n   ".join(_braces(row, single) for row in values) + "}"
    return "{" + ", ".join(c_number(v, single) for v in values) + "}"
