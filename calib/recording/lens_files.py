"""Lenses as others write them: ROS's camera_info, OpenCV's cameraMatrix and distCoeffs."""

from __future__ import annotations

import re

import numpy as np

from ..common.arrays import Array
from ..errors import LogError

MATRIX = "camera_matrix|cameraMatrix|CameraMatrix|intrinsic_matrix|mtx|K|k"
DISTORTION = (
    "distortion_coefficients|distCoeffs|dist_coeffs|distortion|dist|D|d"
)
WIDTH = "image_width|imageWidth|width"
HEIGHT = "image_height|imageHeight|height"
"""Keys in YAML or JSON."""

_NUMBER = (
    r"(?i:[-+]?(?:\.?nan|\.?inf|\d+\.?\d*(?:e[-+]?\d+)?|\.\d+(?:e[-+]?\d+)?))"
)
# what stands between a key and its numbers: a type, and the sizes of a matrix
_ABOUT = (
    r"[\s{]*(?:!!\S+\s+)?"
    r"(?:[\"']?(?:rows|cols|dt|type_id)[\"']?:[^\n,]*[\n,]\s*)*"
    r"(?:[\"']?data[\"']?:)?"
)
_FISHEYE = ("equidistant", "fisheye", "kannala")
_TERMS = 5  # k1, k2, p1, p2, k3

UNSTATED = (0, 0)
"""Size of pictures where a file says none."""


def read_lens(text: str, label: str) -> tuple[tuple[int, int], Array, Array]:
    """Size of the pictures, camera matrix (3, 3) and distortion (5,) of a YAML or JSON text.

    Raises LogError in one line where it has none, where numbers are not finite, or where the lens
    is of another kind.
    """
    matrix = _numbers(text, MATRIX)
    bent = _numbers(text, DISTORTION)
    if len(matrix) != 9:
        raise LogError(
            f"{label} is no lens: expected calib's lens.json, ROS's camera_info, or OpenCV's "
            "cameraMatrix and distCoeffs, in YAML or JSON, or pictures of the board"
        )
    if not np.isfinite([*matrix, *bent]).all() or min(matrix[[0, 4]]) <= 0.0:
        raise LogError(
            f"{label}: focal lengths {matrix[0]:g} and {matrix[4]:g}, distortion "
            f"{bent.tolist()}: expected finite numbers and focal lengths above zero"
        )
    if any(word in text.lower() for word in _FISHEYE) or bent[_TERMS:].any():
        raise LogError(
            f"{label} is a fisheye or rational lens ({len(bent)} terms): expected up to five, k1, "
            "k2, p1, p2, k3; leave the lens out to have it fitted"
        )
    distortion = np.append(bent, np.zeros(_TERMS))[:_TERMS]
    sides = np.append(_numbers(text, WIDTH), _numbers(text, HEIGHT))
    size = (int(sides[0]), int(sides[1])) if len(sides) == 2 else UNSTATED
    return size, matrix.reshape(3, 3), distortion


def _numbers(text: str, keys: str) -> Array:
    """The numbers under the first of some keys, in order; none where no key is there."""
    for key in keys.split("|"):
        block = re.search(
            rf"(?<!\w)[\"']?{key}[\"']?\s*:{_ABOUT}((?:{_NUMBER}|[\s\[\],.]|-\s)*)",
            text,
        )
        if block is not None:
            words = re.findall(_NUMBER, block[1].lower())
            # YAML writes .nan and .inf
            return np.array(
                [w.replace(".n", "n").replace(".i", "i") for w in words], float
            )
    return np.zeros(0)
