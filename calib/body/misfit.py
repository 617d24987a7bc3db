"""Misfit: pixels and orientations that no arm explains, and what would explain them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arm.rotations import logarithm, matrix_of, nearest_rotation
from ..common.arrays import Array
from ..errors import LogError
from .settings import CLEAR
from .spatial_start import frame

if TYPE_CHECKING:
    from .belief import Body
    from .spatial import SpatialStructure

#: A median residual beyond this share of the pixels' extent is no calibration error.
_PIXELS = 0.05
#: A median turn [rad] beyond which orientations are not those of the joints.
_TURNS = 0.3


def refuse_pixels(body: Body, q: Array, pixels: Array) -> None:
    """Refuse pixels (n, 2) that the arm does not explain, and say whether mirrored ones would.

    Raises LogError.
    """
    structure: Any = body.structure
    extent = float(np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).mean())
    residual = _median(pixels - body.predict(q))
    if residual < _PIXELS * extent:
        return
    mirrored = pixels * (-1, 1) + (2 * structure.lens[1], 0)
    rest = _median(mirrored - structure.predict(q, frame(structure, q, mirrored)))
    _refuse(
        residual,
        {
            "the pixels are of a mirrored picture: u or v runs the wrong way, or they are swapped; "
            "write u as the picture's width less u, or v from the top": rest
        },
        f"no camera explains the pixels: it misses them by {residual:.3g} px (median) of "
        f"{extent:.3g}; check the joints' order and unit, and that each row's joints and pixels "
        "are of one moment",
    )


def refuse_turns(structure: SpatialStructure, q: Array, x: Array, quaternions: Array) -> None:
    """Refuse quaternions (n, 4) that do not turn as the joints (n, dof) do, and say what would.

    `x` (n, 3) are the positions, which tell how the sensor's frame is turned: with both ends free,
    quaternions in the order w, x, y, z look like inverted ones, since every orthogonal map of
    quaternions is a q b or a conj(q) b.

    Raises LogError.
    """
    nominal = structure.pose(q, structure.neutral())[1]
    turn = structure.sensor(frame(structure, q, x)).rotation

    def rest(quaternions: Array) -> float:
        """Median angle [rad] that the best Y leaves of seen = turn nominal Y."""
        seen = matrix_of(quaternions)
        y = nearest_rotation((np.swapaxes(nominal, 1, 2) @ turn.T @ seen).sum(axis=0))
        return _median(logarithm(seen @ np.swapaxes(turn @ nominal @ y, 1, 2)))

    residual = rest(quaternions)
    if residual < _TURNS:
        return
    _refuse(
        residual,
        {
            "qx, qy, qz, qw are in the order w, x, y, z; give "
            "`columns={'qx': 'qy', 'qy': 'qz', 'qz': 'qw', 'qw': 'qx'}`": rest(
                quaternions[:, [1, 2, 3, 0]]
            ),
            "the orientations are inverted: of the sensor in the tool's frame, not of the tool": (
                rest(quaternions * (-1, -1, -1, 1))
            ),
        },
        f"the orientations do not turn as the joints do: {np.degrees(residual):.0f} deg are left "
        "(median); check their order, their unit, and that they are of the tip, or leave them out",
    )


def _refuse(residual: float, others: Mapping[str, float], words: str) -> None:
    """Refuse rows with the words of another reading that explains them, else with these."""
    raise LogError(
        next((other for other, rest in others.items() if rest < CLEAR * residual), words)
    )


def _median(residual: Array) -> float:
    return float(np.median(np.linalg.norm(residual, axis=1)))
