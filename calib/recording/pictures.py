"""Pictures of a folder and frames of a video: which, in what order, and whether they are whole."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator, Sequence
from glob import glob
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.choices import PICTURES
from ..common.wording import INSTALL
from ..errors import LogError

Picture = NDArray[np.uint8]
"""Grey (height, width), or with three colours (height, width, 3)."""

Frame = tuple[int, str, Picture]
"""Number and name of a grey picture, and the picture."""


def opencv() -> Any:
    """Import OpenCV and silence what it and FFmpeg write to standard error.

    Raises LogError if it is missing.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault(
        "OPENCV_FFMPEG_LOGLEVEL", "-8"
    )  # read when a video is opened
    try:
        return import_module("cv2")
    except ImportError:
        raise LogError(
            f"reading pictures needs OpenCV: {INSTALL.format('camera')}"
        ) from None


def _natural(path: Path) -> list[tuple[int, int | str]]:
    """A key that sorts `img_10` after `img_9`."""
    parts = re.split(r"(\d+)", path.name)
    return [(0, int(p)) if p.isdigit() else (1, p.lower()) for p in parts if p]


def list_pictures(source: str | os.PathLike[str] | Sequence[str]) -> list[Path]:
    """Return the pictures of a folder, a pattern such as `shots/*.jpg` or names, in natural order.

    Raises LogError if there is none.
    """
    if not isinstance(source, (str, os.PathLike)):
        return sorted(
            {path for name in source for path in list_pictures(name)},
            key=_natural,
        )
    text = os.fspath(source)
    paths = [Path(source)]
    if paths[0].is_dir():
        paths = [
            path
            for path in paths[0].iterdir()
            if path.suffix.lower() in PICTURES
        ]
    elif any(mark in text for mark in "*?["):
        paths = [Path(name) for name in glob(text)]  # noqa: PTH207 - a pattern may start at a root
    paths = [
        path
        for path in paths
        if path.is_file() and not path.name.startswith(".")
    ]
    if not paths:
        kinds = ", ".join(PICTURES)
        raise LogError(
            f"no pictures in {text!r}: expected a folder of {kinds}, or a pattern"
        )
    return sorted(paths, key=_natural)


def read_picture(
    path: str | os.PathLike[str], *, colour: bool = False
) -> Picture:
    """Read a picture whole: grey (height, width), or red, green, blue (height, width, 3).

    By Pillow: OpenCV returns half of a cut JPEG without a word.
    Raises LogError if it is cut off, damaged, too large or no picture.
    """
    from PIL import Image, ImageOps

    try:
        with Image.open(io.BytesIO(Path(path).read_bytes())) as opened:
            opened.load()
            image = ImageOps.exif_transpose(opened)
            if image.mode.startswith("I") or image.mode == "F":
                values = np.asarray(image, float)
                scale = 256.0 if values.max(initial=0.0) > 255 else 1.0
                image = Image.fromarray(
                    np.clip(values / scale, 0, 255).astype(np.uint8)
                )
            return np.array(image.convert("RGB" if colour else "L"))
    except (
        OSError,
        ValueError,
        SyntaxError,
        EOFError,
        MemoryError,
        Image.DecompressionBombError,
    ) as error:
        cut = "truncated" in str(error).lower()
        what = "is cut off" if cut else "is no picture that can be read"
        raise LogError(f"{Path(path).name} {what}") from None


def read_series(paths: Sequence[Path], damaged: list[str]) -> Iterator[Frame]:
    """Yield the grey pictures of one camera; say of others why they are left out.

    Raises LogError if they have several sizes: intrinsics hold for one setting of a camera.
    """
    size: tuple[int, ...] | None = None
    for number, path in enumerate(paths):
        try:
            grey = read_picture(path)
        except LogError as error:
            damaged.append(f"{error}; left out")
            continue
        now = grey.shape[1::-1]
        if size not in (None, now):
            raise LogError(
                f"{path.name} is {now[0]}x{now[1]}, the pictures before it {size[0]}x{size[1]}: "
                "expected one camera with one setting"
            )
        size = now
        yield number, path.name, grey
    if size is None:
        folder = os.fspath(paths[0].parent)
        raise LogError(f"no picture in {folder!r} can be read: {damaged[0]}")


class Video:
    """A video that OpenCV can read; LogError if it is none."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.name = Path(path).name
        try:
            with Path(path).open("rb") as file:
                start = file.read(512)
        except OSError as error:
            raise LogError(
                f"cannot read {os.fspath(path)!r}: {error.strerror}"
            ) from None
        # FFmpeg draws a text file as a video of its letters
        text = bool(start) and all(
            32 <= byte < 127 or byte in b"\r\n\t" for byte in start
        )
        cv2 = opencv()
        self._capture: Any = (
            None if text else cv2.VideoCapture(os.fspath(path), cv2.CAP_FFMPEG)
        )
        if self._capture is None or not self._capture.isOpened():
            raise LogError(
                f"{self.name} is no video that OpenCV can read: expected mp4, mov, avi, mkv or webm"
            )
        self.claimed = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))

    def frames(self) -> Iterator[tuple[float, Picture]]:
        """Yield times [s] and grey frames."""
        cv2 = opencv()
        capture = self._capture
        last = -np.inf
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        while (read := capture.read())[0] and read[1] is not None:
            stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            if not stamp > last:  # a file without times: its rate must do
                stamp = (
                    max(last, 0.0) + 1.0 / rate
                    if rate > 0 and last > -np.inf
                    else 0.0
                )
            last = stamp
            frame = read[1]
            yield (
                stamp,
                frame
                if frame.ndim == 2
                else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY),
            )
        capture.release()
