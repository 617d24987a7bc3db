"""OpenCV, where it is installed: imported late, silent, old versions refused."""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.wording import INSTALL
from ..errors import LogError

Picture = NDArray[np.uint8]
"""Grey (height, width), or with three colours (height, width, 3)."""

_INSTALL = f"reading pictures needs OpenCV: {INSTALL.format('camera')}"


def opencv() -> Any:
    """Import OpenCV and silence what it and FFmpeg write to standard error.

    Raises LogError if it is missing or older than 4.11.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # read when a video is opened
    try:
        cv2: Any = import_module("cv2")
    except ImportError:
        raise LogError(_INSTALL) from None
    if tuple(int(part) for part in cv2.__version__.split(".")[:2]) < (4, 11):
        raise LogError(f"OpenCV {cv2.__version__} is too old, expected 4.11 or later: {_INSTALL}")
    if hasattr(cv2, "setLogLevel"):  # 4.x
        cv2.setLogLevel(0)
    else:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2
