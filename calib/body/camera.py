"""Camera: what pictures of an arm could not tell, which poses would, and pixels of no camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.arrays import Array
from ..errors import LogError
from .sensor import SensorPose
from .spatial_start import frame

if TYPE_CHECKING:
    from .posterior import BodyFit

#: A camera whose distance is less sure than this share of it was shown too little.
UNSURE = 0.1
#: A median residual beyond this share of the pixels' extent is no calibration error.
MISFIT = 0.05
#: Mirrored pixels that fit so much better say that the picture is mirrored.
_CLEAR = 0.3
#: Poses that are drawn to find out how far the tip can move along the view.
_DRAWN = 400


def told_by(fit: BodyFit, q: Array, pixels: Array, lower: Array, upper: Array) -> list[str]:
    """Say what pictures could not tell, and which poses would.

    Raises LogError if the arm does not explain the pixels, or only mirrored ones.
    """
    body = fit.body
    structure: Any = body.structure
    _refuse_misfit(fit, q, pixels)
    camera = SensorPose.of(body)
    if camera is None:
        return []
    ahead, eye = camera.rotation[:, 2], camera.position
    depths = (structure.pose(q, body.beta)[0] - eye) @ ahead
    middle, notes = float(np.mean(depths)), []
    if middle <= 0:
        raise LogError(
            "the fit places the arm behind the camera: check that each row's joints and pixels "
            "belong together"
        )
    if 1.96 * camera.depth_sd > UNSURE * middle:
        q = np.random.default_rng(0).uniform(lower, upper, (_DRAWN, len(lower)))
        can = (structure.pose(q, body.beta)[0] - eye) @ ahead
        moving = np.abs([np.polyfit(column, can, 1)[0] for column in q.T]) * (upper - lower)
        names = [structure.joint_names[k] for k in np.argsort(-moving)[:2]]
        notes.append(
            f"the pixels hardly determine the distance of the camera: {middle:.2f} m, 95 % within "
            f"{1.96 * camera.depth_sd:.2g} m. The tip moved {np.ptp(depths):.2g} m along the view "
            f"where {np.ptp(can):.2g} m are possible: add poses nearer to the camera and further "
            f"from it (turn {' and '.join(names)}), or give a calibrated `lens`"
        )
    return notes


def _refuse_misfit(fit: BodyFit, q: Array, pixels: Array) -> None:
    structure: Any = fit.body.structure
    extent = float(np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).mean())
    left = float(np.median(np.linalg.norm(pixels - fit.body.predict(q), axis=1)))
    if left < MISFIT * extent:
        return
    mirrored = pixels * (-1, 1) + (2 * structure.lens[1], 0)
    beta = frame(structure, q, mirrored)
    rest = float(np.median(np.linalg.norm(mirrored - structure.predict(q, beta), axis=1)))
    if rest < _CLEAR * left:
        raise LogError(
            "the pixels are of a mirrored picture: u or v runs the wrong way, or they are swapped; "
            "write u as the picture's width less u, or v from the top"
        )
    raise LogError(
        f"no camera explains the pixels: it misses them by {left:.3g} px (median) of {extent:.3g}; "
        "check the joints' order and unit, and that each row's joints and pixels are of one moment"
    )
