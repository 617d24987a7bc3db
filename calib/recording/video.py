"""Frames of a video with their times."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import LogError
from .opencv import Picture, opencv


class Video:
    """A video that OpenCV can read; LogError if it is none."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        cv2 = opencv()
        self.name = Path(path).name
        try:
            with Path(path).open("rb") as file:
                start = file.read(512)
        except FileNotFoundError:
            raise LogError(f"there is no file {os.fspath(path)!r}") from None
        except OSError as error:
            raise LogError(f"cannot read {os.fspath(path)!r}: {error.strerror}") from None
        # FFmpeg draws a text file as a video of its letters
        text = bool(start) and all(32 <= byte < 127 or byte in b"\r\n\t" for byte in start)
        self._capture: Any = None if text else cv2.VideoCapture(os.fspath(path), cv2.CAP_FFMPEG)
        if self._capture is None or not self._capture.isOpened():
            raise LogError(
                f"{self.name} is no video that OpenCV can read: expected mp4, mov, avi, mkv or webm"
            )
        self.claimed = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))

    def frames(self) -> Iterator[tuple[float, Picture]]:
        """Yield times [s] and grey frames."""
        cv2, capture = opencv(), self._capture
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        last = -np.inf
        while (read := capture.read())[0] and read[1] is not None:
            frame = read[1]
            stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            if not stamp > last:  # a file without times: its rate must do
                stamp = max(last, 0.0) + 1.0 / rate if rate > 0 and last > -np.inf else 0.0
            last = stamp
            yield stamp, frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        capture.release()
