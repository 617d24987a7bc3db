"""Photos: a small one for a model, and one with the tag's places drawn over it."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..common.arrays import Array
from ..common.atomic import atomic_write
from ..common.choices import PICTURES, VIDEOS
from ..errors import LogError
from ..model.about import Photo
from .pictures import Picture, Video, opencv, read_picture
from .setting import Setup
from .tags import TagFinder

WIDEST = 1000
"""Pixels along a kept photo's longer side, at most."""

COLOURS = {
    "tag": (60, 200, 60),
    "mark": (230, 90, 230),
    "place": (255, 200, 0),
}
"""Red, green and blue of what is drawn."""


def take_photo(
    path: str | os.PathLike[str],
    x: Array,
    unit: str,
    about: Mapping[str, object] | None = None,
) -> Photo:
    """Read a photo so that positions can be drawn over it.

    path : a picture or a video, whose first frame is taken, by the camera that made the log
    x : (n, 2), positions that should be in it [px]
    about : what the log tells of its source (`Source.about`)
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
        return read_picture(path, colour=True)
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
    """Return a JPEG of at most `WIDEST` pixels a side."""
    from PIL import Image

    image = Image.fromarray(picture)
    image.thumbnail((WIDEST, WIDEST), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=82, optimize=True)
    return buffer.getvalue()


def write_overlay(
    path: str | os.PathLike[str], photo: Picture, setting: Setup, places: Array
) -> None:
    """Write a photo as PNG with its tags, its marks, and the tag's places in all rows of a log.

    The photo is red, green, blue; `places` (n, 2) [px] are those of the tag's centre.
    """
    cv2 = opencv()
    canvas = photo.copy()
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)
    tags = TagFinder(setting.dictionary).find(grey)
    if tags:
        corners = [tag.corners[None].astype(np.float32) for tag in tags]
        numbers = np.array([tag.number for tag in tags])
        cv2.aruco.drawDetectedMarkers(canvas, corners, numbers, COLOURS["tag"])
    marks = {} if setting.board is None else setting.marks(grey, ())
    radius = max(3, round(max(canvas.shape) / 213))
    circles = {"place": places, "mark": marks.values()}
    for what, centres in circles.items():
        colour = COLOURS[what]
        for centre in centres:
            middle = np.round(centre).astype(int).tolist()
            cv2.circle(canvas, middle, radius, colour, -1, cv2.LINE_AA)
    _, png = cv2.imencode(".png", canvas[:, :, ::-1])
    atomic_write(path, png.tobytes())
