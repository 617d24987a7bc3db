"""Tables and words of the C source of a spatial body."""

from __future__ import annotations

import numpy as np

from ..arm.motion import placements
from ..body.spatial import SpatialStructure
from ..body.spatial_view import NEAREST
from ..common.arrays import Array
from .c_source import array, integers, number
from .c_spatial import LINEAR, SEEN_BY_CAMERA

_POSES, _POSE_CALM = 2, 1e-6  # steps towards a pose, and their damping


def words(structure: SpatialStructure, single: bool) -> dict[str, object]:
    """Numbers and lines that stand in the source itself."""
    lever = structure.chain.reach
    return {
        "law": structure.seen_as.source,
        "nearest": number(NEAREST, single),
        "view": SEEN_BY_CAMERA if structure.camera else LINEAR,
        "poses": _POSES,
        "pose_calm": number(_POSE_CALM, single),
        "lever": number(lever, single),
        "half_lever": number(lever / 2, single),
    }


def tables(structure: SpatialStructure, beta: Array, single: bool) -> str:
    """Constant tables of a spatial body: the chain, its loads, its curves and the sensor."""
    chain, sensor = structure.chain, structure.sensor(beta)
    real = "calib_real"
    weighed = chain.masses if len(chain.masses) else np.zeros(chain.joints)
    middle = chain.centres - chain.points if len(chain.masses) else np.zeros((chain.joints, 3))
    gravity = np.asarray(structure.gravity) / structure.loads.torque
    rows, dof = "CALIB_CHAIN", "CALIB_DOF"
    return (
        f"\nenum {{ CALIB_CHAIN = {chain.joints} }};\n"
        + integers("calib_bends", rows, chain.revolute)
        + array(real, "calib_axis", [rows, "3"], chain.axes, single)
        + array(real, "calib_stride", [rows, "3"], placements(chain).strides, single)
        + array(real, "calib_coupling", [rows, dof], chain.coupling, single)
        + array(real, "calib_bias", [rows], chain.bias, single)
        + array(real, "calib_mass", [rows], weighed, single)
        + array(real, "calib_centre", [rows, "3"], middle, single)
        + array(real, "calib_gravity", ["3"], gravity, single)
        + array(real, "calib_view", ["9"], sensor.scale * sensor.rotation, single)
        + array(real, "calib_aim", ["9"], sensor.rotation, single)
        + array(real, "calib_shift", ["3"], sensor.shift, single)
        + array(real, "calib_lens", ["4"], sensor.lens, single)
        + _ARM
        + arm("calib_body", structure, beta, single)
    )


_ARM = """
/* An arm: joint values are gain q + offset + curve, and bend under gravity. */
typedef struct {
  calib_real gain[CALIB_DOF], offset[CALIB_DOF], bending[CALIB_CHAIN];
  calib_real stride[CALIB_CHAIN][3], turned[CALIB_CHAIN][9], tip[3], tip_turn[9];
  int curves, elastic;
} calib_arm;
"""


def arm(name: str, structure: SpatialStructure, beta: Array, single: bool) -> str:
    """The constant of one arm: the body, or the nominal one."""
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
    curves = any(
        beta[groups[f"curve.{k}"]].any() for k in range(structure.dof) if len(groups[f"curve.{k}"])
    )
    words = [_braces(np.asarray(part), single) for part in parts]
    flags = f"{int(curves)}, {int(elastic.any())}"
    return f"\nstatic const calib_arm {name} = {{\n  " + ",\n  ".join([*words, flags]) + "\n};\n"


def _braces(values: Array, single: bool) -> str:
    """Numbers in the braces of a C constant, row by row."""
    if values.ndim == 2:
        return "{" + ",\n   ".join(_braces(row, single) for row in values) + "}"
    return "{" + ", ".join(number(v, single) for v in values) + "}"
