"""Misfit: pixels that no arm explains, and whether those of a mirrored picture would be."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.arrays import Array
from ..errors import LogError
from .settings import CLEAR
from .spatial_start import frame

if TYPE_CHECKING:
    from .belief import Body

#: A median residual beyond this share of the pixels' extent is no calibration error.
_PIXELS = 0.05


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
    if _median(mirrored - structure.predict(q, frame(structure, q, mirrored))) < CLEAR * residual:
        raise LogError(
            "the pixels are of a mirrored picture: u or v runs the wrong way, or they are swapped; "
            "write u as the picture's width less u, or v from the top"
        )
    raise LogError(
        f"no camera explains the pixels: it misses them by {residual:.3g} px (median) of "
        f"{extent:.3g}; check the joints' order and unit, and that each row's joints and pixels "
        "are of one moment"
    )


def _median(residual: Array) -> float:
    return float(np.median(np.linalg.norm(residual, axis=1)))
