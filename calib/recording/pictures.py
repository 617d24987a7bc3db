"""Pictures of a folder and frames of a video: which, in what order, and whether they are whole."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from glob import escape, glob
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.atomic import FilePath
from ..common.choices import PICTURES, VIDEOS
from ..common.wording import INSTALL
from ..errors import LogError
from ..model.about import Photo

Picture = NDArray[np.uint8]
"""Grey (height, width), or with three colours (height, width, 3)."""

Shot = tuple[int, str, Picture]
"""A grey picture of a recording: its number, its name, and the picture."""

WIDEST = 1000
"""Most pixels along the longer side of a photo that a model keeps."""


def opencv() -> ModuleType:
    """Import OpenCV and silence what it writes to standard error; LogError if it is missing."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    return package("cv2")


def package(name: str) -> ModuleType:
    """Import a package of the extra `camera`; LogError if it is missing."""
    try:
        return import_module(name)
    except ImportError:
        what = {
            "cv2": "pictures needs OpenCV",
            "av": "videos needs PyAV",
            "yaml": "YAML needs PyYAML",
        }[name]
        raise LogError(f"reading {what}: {INSTALL.format('camera')}") from None


@contextmanager
def one_thread() -> Iterator[None]:
    """Run OpenCV in one thread: several sum in any order, which changes the last digits."""
    cv2 = opencv()
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def natural_key(path: Path) -> str:
    """Return a key that sorts `img_10` after `img_9`."""
    return re.sub(r"\d+", lambda digits: digits[0].zfill(20), path.name.lower())


def list_pictures(source: FilePath | Sequence[str]) -> list[Path]:
    """Return the pictures of a folder, a pattern such as `shots/*.jpg` or names, in natural order.

    Raises LogError if there is none.
    """
    if not isinstance(source, (str, os.PathLike)):
        return sorted(
            {path for name in source for path in list_pictures(name)},
            key=natural_key,
        )
    text = os.fspath(source)
    is_folder = Path(source).is_dir()
    pattern = f"{escape(text)}/*" if is_folder else text
    names = glob(pattern)  # noqa: PTH207 - a pattern may start at a root
    if is_folder:
        names = [name for name in names if name.lower().endswith(PICTURES)]
    paths = [Path(name) for name in names if Path(name).is_file()]
    if not paths:
        kinds = ", ".join(PICTURES)
        raise LogError(
            f"no pictures in {text!r}: expected a folder of {kinds}, or a pattern"
        )
    return sorted(paths, key=natural_key)


def read_picture(path: Path, mode: str) -> tuple[Picture, int]:
    """Read a picture, and how EXIF turns it: 1 not, 3 is upside down, 6 and 8 are on a side.

    mode : "RGB" for red, green, blue (height, width, 3), "L" for grey (height, width)
    Pillow reads it: OpenCV returns half of a cut JPEG without an error.
    Raises LogError if it is cut off, damaged, too large or no picture.
    """
    from PIL import ExifTags, Image, ImageOps

    try:
        with Image.open(io.BytesIO(path.read_bytes())) as opened:
            opened.load()
            turn = opened.getexif().get(ExifTags.Base.Orientation, 1)
            image = ImageOps.exif_transpose(opened)
            return np.array(image.convert(mode)), turn
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
        raise LogError(f"{path.name} {what}") from None


def read_series(paths: Sequence[Path], notes: list[str]) -> Iterator[Shot]:
    """Yield the grey pictures of one camera; notes say why some are left out, how EXIF turns all.

    Raises LogError if they have several sizes, or EXIF turns some: intrinsics hold for one setting.
    """
    setting = ""
    for number, path in enumerate(paths):
        try:
            grey, turn = read_picture(path, "L")
        except LogError as error:
            notes.append(f"{error}; left out")
            continue
        now = f"{grey.shape[1]}x{grey.shape[0]}"
        if turn != 1:
            now += f", turned by EXIF {turn}"
            if not setting:
                notes.append(
                    f"pictures are {now}, as OpenCV's imread does: camera and lens are those of "
                    "the turned pictures"
                )
        setting = setting or now
        if setting != now:
            raise LogError(
                f"{path.name} is {now}, the pictures before it {setting}: expected one camera with "
                "one setting, which turns no picture"
            )
        yield number, path.name, grey
    if not setting:
        folder = os.fspath(paths[0].parent)
        raise LogError(f"no picture in {folder!r} can be read: {notes[0]}")


class Video:
    """A video that FFmpeg can read; LogError if it is none."""

    def __init__(self, path: FilePath) -> None:
        self.name = Path(path).name
        self._decoder = package("av")
        try:
            self._container = self._decoder.open(os.fspath(path))
            self.claimed = int(self._container.streams.video[0].frames)
        except (OSError, ValueError, IndexError) as error:
            raise LogError(
                f"video {os.fspath(path)!r} cannot be read ({error}): expected mp4, mov, avi, mkv "
                "or webm"
            ) from None

    def frames(self) -> Iterator[tuple[float, Picture]]:
        """Yield times [s] and grey frames, up to where the video is cut off or damaged."""
        cv2 = opencv()
        with self._container, suppress(self._decoder.error.FFmpegError):
            for image in self._container.decode(video=0):
                colours = image.to_ndarray(format="bgr24")
                grey = cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)
                yield float(image.time), grey

    def notes(self, count: int) -> list[str]:
        """What is left out where `count` frames can be read."""
        if self.claimed <= 1.05 * count + 2:
            return []
        return [f"{count} of {self.claimed} frames can be read: it is cut off"]


def take_photo(
    path: FilePath,
    x: Array,
    unit: str,
    about: Mapping[str, object] | None = None,
) -> Photo:
    """Read a photo so that positions can be drawn over it.

    path : a picture or a video, whose first frame is taken, by the camera that made the log
    x : (n, 2), positions that should be in it [px]
    about : the log's description of its source (`Source.about`)
    Raises LogError if it cannot be read, is of another camera, or shows none of the positions.
    """
    about = about or {}
    picture = read_photo(Path(path))
    name = Path(path).name
    height, width = picture.shape[:2]
    if about.get("size") not in (None, [width, height]):
        raise LogError(
            f"{name} is {width}x{height}, the log's pictures were {about['size']!r:.40}: expected "
            "one by the same camera"
        )
    if x.shape[1] != 2 or unit != "px":
        raise LogError(
            f"positions in {unit}, {x.shape[1]} coordinates, are not drawn over a photo: expected "
            "x and y in px"
        )
    edge = np.array([width, height]) - 0.5
    inside = ((x > -0.5) & (x < edge)).all(axis=1)
    if inside.mean() < 0.25:
        raise LogError(
            f"{name} shows {100 * inside.mean():.0f} % of the positions only: expected a picture "
            "by the camera that made the log"
        )
    box = (-0.5, width - 0.5, height - 0.5, -0.5)
    return Photo(np.frombuffer(_jpeg(picture), np.uint8), box)


def read_photo(path: Path) -> Picture:
    """Return a picture, or the first frame of a video, as red, green, blue."""
    if path.suffix.lower() in PICTURES:
        return read_picture(path, "RGB")[0]
    if path.suffix.lower() not in VIDEOS:
        kinds = ", ".join((*PICTURES, *VIDEOS))
        raise LogError(
            f"{path.name} is no picture or video by its name: expected {kinds}"
        )
    grey = next((frame for _, frame in Video(path).frames()), None)
    if grey is None:
        raise LogError(f"{path.name} has no frame that can be read")
    return np.repeat(grey[:, :, None], 3, axis=2)


def _jpeg(picture: Picture) -> bytes:
    """A JPEG of at most `WIDEST` pixels a side."""
    from PIL import Image

    image = Image.fromarray(picture)
    image.thumbnail((WIDEST, WIDEST), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=82, optimize=True)
    return buffer.getvalue()
