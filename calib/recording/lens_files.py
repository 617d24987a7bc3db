"""Lenses as others write them: ROS's camera_info, OpenCV's cameraMatrix and distCoeffs."""

from __future__ import annotations

import json
import re

import numpy as np

from ..common.arrays import Array
from ..errors import LogError

MATRIX = (
    "camera_matrix",
    "cameraMatrix",
    "CameraMatrix",
    "intrinsic_matrix",
    "mtx",
    "K",
    "k",
)
DISTORTION = (
    "distortion_coefficients",
    "distCoeffs",
    "dist_coeffs",
    "distortion",
    "dist",
    "D",
    "d",
)
WIDTH = ("image_width", "imageWidth", "width")
HEIGHT = ("image_height", "imageHeight", "height")

_NUMBER = re.compile(
    r"[-+]?(?:\.?nan|\.?inf|\d+\.?\d*(?:e[-+]?\d+)?|\.\d+(?:e[-+]?\d+)?)", re.I
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
    matrix = _values(text, MATRIX)
    if len(matrix) != 9:
        raise LogError(
            f"{label} is no lens: expected calib's lens.json, ROS's camera_info, or OpenCV's "
            "cameraMatrix and distCoeffs, in YAML or JSON, or pictures of the board"
        )
    bent = _values(text, DISTORTION)
    camera = np.reshape(matrix, (3, 3))
    whole = np.isfinite(camera).all() and np.isfinite(bent).all()
    if not whole or min(camera[0, 0], camera[1, 1]) <= 0.0:
        raise LogError(
            f"{label}: focal lengths {camera[0, 0]:g} and {camera[1, 1]:g}, distortion "
            f"{bent.tolist()}: expected finite numbers and focal lengths above zero"
        )
    if any(word in text.lower() for word in _FISHEYE) or np.any(bent[_TERMS:]):
        raise LogError(
            f"{label} is a fisheye or rational lens ({len(bent)} terms): expected up to five, k1, "
            "k2, p1, p2, k3; leave the lens out to have it fitted"
        )
    distortion = np.zeros(_TERMS)
    distortion[: len(bent[:_TERMS])] = bent[:_TERMS]
    width = _values(text, WIDTH)
    height = _values(text, HEIGHT)
    size = UNSTATED
    if len(width) == 1 and len(height) == 1:
        size = (int(width[0]), int(height[0]))
    return size, camera, distortion


def _values(text: str, names: tuple[str, ...]) -> Array:
    """The numbers under the first of some keys, in order; none where no key is there."""
    try:
        document = json.loads(text)
    except ValueError:
        document = None
    for name in names:
        if isinstance(document, dict):
            if name in document:
                return _flat(document[name])
            continue
        # a key at the start of a line, and all below it up to the next one
        block = re.search(
            rf"^\s*[\"']?{name}[\"']?\s*:(.*?)(?=^[^\s\-\[\]]|\Z)",
            text,
            re.MULTILINE | re.DOTALL,
        )
        if block is None:
            continue
        part = block[1]
        if "data" in part:
            part = part.partition("data")[2]
        elif "\n" in part.strip() and "[" not in part and "-" not in part:
            part = part.strip().splitlines()[0]
        return np.array([_number(word) for word in _NUMBER.findall(part)])
    return np.zeros(0)


def _flat(value: object) -> Array:
    """Numbers of a JSON value: lists of lists, or a mapping with `data`."""
    if isinstance(value, dict):
        value = value.get("data", [])
    try:
        return np.ravel(np.array(value, float))
    except (TypeError, ValueError):
        return np.zeros(0)


def _number(word: str) -> float:
    return float(word.replace(".nan", "nan").replace(".inf", "inf"))
