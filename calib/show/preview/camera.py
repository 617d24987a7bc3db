"""Camera: from where a scene is seen, so that all of it is in the picture."""

import numpy as np

from ...common.arrays import Array
from ..placement import Placement

OBLIQUE = np.array([[0.866, 0.5, 0.0], [0.0, 0.0, 1.0], [0.5, -0.866, 0.0]])
"""Rows right, up and towards the eye of an upright plane, from where a space is seen."""


def frame_of_view(placement: Placement, *, downwards: bool) -> Array:
    """Rows right, up and towards the eye (3, 3) of the drawn plane; of a space an oblique one's.

    downwards : whether y counts downwards, as pixels do
    """
    if placement.matrix.shape[1] == 4:
        return OBLIQUE
    right, up = placement.lift(np.eye(2)) - placement.lift(np.zeros((1, 2)))
    normal = np.cross(right, -up if downwards else up)
    if normal[2] < -0.5 * np.linalg.norm(normal):  # from above
        normal = -normal
    rows = np.stack([right, np.cross(normal, right), normal])
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def camera_onto(points: Array, frame: Array) -> dict[str, object]:
    """A perspective camera that shows points (n, 3), as the page computes it.

    Returns "target", middle of the picture, "direction", unit vector from there to the camera,
    "half", half the extent of what is shown along right, up and depth, "fov" and "margin".
    """
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    up = np.array([0.0, 0.0, 1.0])
    # off the plane's normal, so that depth can be seen; from above, y leads up the screen
    upright = abs(frame[2] @ up) < 0.75
    to_eye = frame[2] + 0.45 * (up if upright else -frame[1])
    direction = to_eye / np.linalg.norm(to_eye)
    right = np.cross(up, direction)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(direction, right), direction])
    half = np.abs((points - target) @ axes.T).max(axis=0)
    return {
        "target": target.tolist(),
        "direction": direction.tolist(),
        "half": half.tolist(),
        "fov": 35.0,  # degrees, from bottom to top
        "margin": 1.1,
    }
