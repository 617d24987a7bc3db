"""Camera: from where a scene is seen, so that all of it is in the picture."""

from __future__ import annotations

import math

import numpy as np

from ...common.arrays import Array
from ..placement import Placement

_FIELD_OF_VIEW = 35.0  # degrees, from bottom to top


def space_frame(azimuth: float = -60.0) -> Array:
    """Rows right, up and towards the eye (3, 3) of an upright plane; `azimuth` [deg] of its eye."""
    c = math.cos(math.radians(azimuth))
    s = math.sin(math.radians(azimuth))
    return np.array([[-s, c, 0.0], [0.0, 0.0, 1.0], [c, s, 0.0]])


def frame_of_view(placement: Placement, *, downwards: bool = False) -> Array:
    """Rows right, up and towards the eye (3, 3) of the drawn plane; of a space an oblique one's.

    downwards : whether y counts downwards, as pixels do
    """
    width = placement.matrix.shape[1] - 1
    if width == 3:
        return space_frame()
    right, up = placement.lift(np.eye(2)) - placement.lift(np.zeros((1, 2)))
    right = right / np.linalg.norm(right)
    normal = np.cross(right, -up if downwards else up)
    normal = normal / np.linalg.norm(normal)
    if normal[2] < -0.5:  # from above
        normal = -normal
    return np.stack([right, np.cross(normal, right), normal])


def camera_onto(
    points: Array, frame: Array, eye: Array | None = None, tilt: float = 24.0
) -> dict[str, object]:
    """A perspective camera that shows points (n, 3), as the page computes it.

    Returns "target", middle of the picture, "direction", unit vector from there to the camera,
    "half", half the extent of what is shown along right, up and depth, "fov" and "margin"; with
    an `eye` (3,), where a photo was taken from, "eye", its distance.

    tilt : off the plane's normal, so that depth can be seen [deg]
    """
    up = np.array([0.0, 0.0, 1.0])
    if eye is not None:
        away = eye - (points.min(axis=0) + points.max(axis=0)) / 2
        direction = away / np.linalg.norm(away)
    else:
        normal = frame[2]
        upright = abs(normal @ up) < 0.75
        towards = (
            up if upright else -frame[1]
        )  # from above, y leading up the screen
        angle = math.radians(tilt)
        direction = math.cos(angle) * normal + math.sin(angle) * towards
        direction = direction / np.linalg.norm(direction)
    right = np.cross(up, direction)
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(direction, right), direction])
    box = points @ axes.T
    low = box.min(axis=0)
    high = box.max(axis=0)
    target = (low + high) / 2 @ axes
    camera: dict[str, object] = {
        "target": target.tolist(),
        "direction": direction.tolist(),
        "half": ((high - low) / 2).tolist(),
        "fov": _FIELD_OF_VIEW,
        "margin": 1.1,
    }
    if eye is not None:
        camera["target"] = (eye - np.linalg.norm(away) * direction).tolist()
        camera["eye"] = float(np.linalg.norm(away))
    return camera
