"""Poses: a fit to positions and orientations, and orientations that are not those of an arm."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arm.rotations import logarithm, matrix_of, nearest_rotation
from ..common.arrays import Array
from ..errors import LogError
from .spatial_start import frame

if TYPE_CHECKING:
    from .belief import Body
    from .posterior import BodyFit
    from .spatial import SpatialStructure

#: A median turn [rad] beyond which orientations are not those of the joints.
MISFIT = 0.3
_CLEAR = 0.3


def turn_misfit(nominal: Array, seen: Array, x: Array) -> float:
    """Median angle [rad] that the best Y leaves of seen = X nominal Y, all (n, 3, 3).

    X has to be known, from positions: with X and Y both free, quaternions in the order w, x, y, z
    look like inverted ones, since every orthogonal map of quaternions is a q b or a conj(q) b.
    """
    y = nearest_rotation((np.swapaxes(nominal, 1, 2) @ x.T @ seen).sum(axis=0))
    left = seen @ np.swapaxes(x @ nominal @ y, 1, 2)
    return float(np.median(np.linalg.norm(logarithm(left), axis=1)))


def refuse_misfit(structure: SpatialStructure, q: Array, x: Array, quaternions: Array) -> None:
    """Refuse quaternions (n, 4) that do not turn as the joints (n, dof) do, and say what would.

    `x` (n, 3) are the positions, which tell how the sensor's frame is turned.

    Raises LogError.
    """
    nominal = structure.pose(q, structure.neutral())[1]
    turn = structure.sensor(frame(structure, q, x)).rotation
    own = turn_misfit(nominal, matrix_of(quaternions), turn)
    if own < MISFIT:
        return
    others = {
        "qx, qy, qz, qw are in the order w, x, y, z; give "
        "`columns={'qx': 'qy', 'qy': 'qz', 'qz': 'qw', 'qw': 'qx'}`": quaternions[:, [1, 2, 3, 0]],
        "the orientations are inverted: of the sensor in the tool's frame, not of the tool": (
            quaternions * (-1, -1, -1, 1)
        ),
    }
    for words, other in others.items():
        if turn_misfit(nominal, matrix_of(other), turn) < _CLEAR * own:
            raise LogError(words)
    raise LogError(
        f"the orientations do not turn as the joints do: {np.degrees(own):.0f} deg are left "
        "(median); check their order, their unit, and that they are of the tip, or leave them out"
    )


def positions_of(fit: BodyFit) -> BodyFit:
    """A fit to poses as one of positions, with the orientations' errors beside it.

    The parameters that the orientations told are kept, the tool's rotation among them.
    """
    body = fit.body
    second = body.second and replace(body.second, noise=body.second.noise[:3])
    structure: Any = body.structure
    positions = replace(
        body,
        structure=structure.with_view("rigid"),
        noise=body.noise[:3],
        tau=body.tau[:3],
        residual=body.residual[:3],
        second=second,
    )
    turned = np.linalg.norm(fit.held_out[:, 3:], axis=1)
    return replace(fit, body=positions, held_out=fit.held_out[:, :3], turned=turned)


def knows_orientation(body: Body | None) -> bool:
    """Whether a body was learned from orientations too."""
    if body is None or body.structure.kind != "spatial":
        return False
    return bool(np.isin(body.structure.groups["tool.rotation"], body.active).all())
