"""Camera: where a fitted camera stands, how sure that is, and what pictures could not tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arm.rotations import cross_matrix, quaternion_of
from ..errors import LogError
from .belief import Body
from .spatial_start import frame
from .spatial_words import camera_place
from .structure import Array

if TYPE_CHECKING:
    from .posterior import BodyFit
    from .spatial import SpatialStructure

#: A camera whose distance is less sure than this share of it was shown too little.
UNSURE = 0.1
#: A median residual beyond this share of the pixels' extent is no calibration error.
MISFIT = 0.05
#: Mirrored pixels that fit so much better say that the picture is mirrored.
_CLEAR = 0.3
#: Poses that are drawn to find out how far the tip can move along the view.
_DRAWN = 400


@dataclass(frozen=True, eq=False)
class CameraPose:
    """A camera in the arm's base frame, and how sure it is.

    The first turning joint's offset is zero by convention: the camera turned about that joint's
    axis, and the offset the other way, give the same pixels. The spreads do not count that turn.

    Attributes
    ----------
    position : (3,) array [m]
    rotation : (3, 3) array
        Its columns are the camera's x (right), y (down) and z (ahead).
    position_sd, turn_sd : (3,) array [m, rad]
        Along and about the base's axes.
    depth_sd : float [m]
        Along the camera's z.
    lens : (4,) array
        Focal length, centre [px] and k1.
    """

    position: Array
    rotation: Array
    position_sd: Array
    turn_sd: Array
    depth_sd: float
    lens: Array

    @staticmethod
    def of(body: Body) -> CameraPose | None:
        """The camera of a body that was learned from pixels of an arm in space; else None."""
        structure: Any = body.structure
        if structure.kind != "spatial" or structure.view != "pinhole":
            return None
        groups, beta = structure.groups, body.beta
        position, rotation = camera_place(structure, beta)
        index = np.concatenate([groups["view.rotation"], groups["view.shift"]])
        place = np.searchsorted(body.active, index)
        covariance = body.covariance[np.ix_(place, place)]
        # position = -R' t; R turned by d on its left moves it by R' (d x t)
        slope = -np.hstack([rotation @ cross_matrix(beta[groups["view.shift"]]), rotation])
        spread = slope @ covariance @ slope.T
        turns = rotation @ covariance[:3, :3] @ rotation.T
        ahead = rotation[:, 2]
        return CameraPose(
            position,
            rotation,
            np.sqrt(np.diag(spread)),
            np.sqrt(np.diag(turns)),
            float(np.sqrt(ahead @ spread @ ahead)),
            beta[groups["lens"]],
        )

    @property
    def quaternion(self) -> Array:
        """The rotation as qx, qy, qz, qw."""
        return quaternion_of(self.rotation)

    def to_json(self) -> dict[str, Any]:
        """Position [m] with 95 % intervals, quaternion, and 95 % of its turns [rad]."""
        half = 1.96 * self.position_sd
        return {
            "frame": "base",
            "position": self.position.tolist(),
            "position_interval": np.stack([self.position - half, self.position + half], 1).tolist(),
            "quaternion": self.quaternion.tolist(),
            "turn_95": (1.96 * self.turn_sd).tolist(),
            "depth_95": 1.96 * self.depth_sd,
        }


def turning_first(structure: SpatialStructure) -> str | None:
    """Name of the joint whose offset cannot be told from a turn of the camera."""
    first = next((k for k, turns in enumerate(structure.turning) if turns), None)
    return structure.joint_names[first] if first == 0 else None


def told_by(fit: BodyFit, q: Array, pixels: Array, lower: Array, upper: Array) -> list[str]:
    """Say what pictures could not tell, and which poses would.

    Raises
    ------
    LogError
        If the arm does not explain the pixels, or only mirrored ones.
    """
    body = fit.body
    structure: Any = body.structure
    _refuse_misfit(fit, q, pixels)
    camera = CameraPose.of(body)
    if camera is None:
        return []
    ahead, eye = camera.rotation[:, 2], camera.position
    depths = (structure.pose(q, body.beta)[0] - eye) @ ahead
    middle, notes = float(np.mean(depths)), []
    if middle <= 0:
        raise LogError("the pixels are of an arm behind the camera: are joints and pixels of one?")
    if 1.96 * camera.depth_sd > UNSURE * middle:
        q = np.random.default_rng(0).uniform(lower, upper, (_DRAWN, len(lower)))
        can = (structure.pose(q, body.beta)[0] - eye) @ ahead
        moving = np.abs([np.polyfit(column, can, 1)[0] for column in q.T]) * (upper - lower)
        names = [structure.joint_names[k] for k in np.argsort(-moving)[:2]]
        notes.append(
            f"the pictures hardly tell how far the camera is: {middle:.2f} m, 95 % within "
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
            "the pixels are of a mirrored picture: u or v runs the wrong way; write u as the "
            "picture's width less u, or v from the top"
        )
    raise LogError(
        f"no camera explains the pixels: it misses them by {left:.3g} px (median) of {extent:.3g}; "
        "check the joints' order and unit, and that each row's joints and pixels are of one moment"
    )
