"""A photo with what was seen in it: the tip's tag, other tags, the board, the tag's places."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from ..common.atomic import atomic_write
from .board import BoardFinder
from .opencv import opencv
from .setting import Setting
from .tags import Tag, TagFinder

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# blue, green, red
_TIP = (60, 200, 60)
_OTHER = (210, 210, 210)
_BOARD = (230, 90, 230)
_PLACES = (0, 200, 255)
_FINE = 4  # bits of a pixel's fraction


def draw_seen(photo: Picture, setting: Setting, places: Array) -> Picture:
    """Draw what a picture shows, and where the tag was in all rows of a log.

    The photo is grey or red, green, blue; `places` (n, 2) [px] are where the tag's centre was seen.
    The drawing (height, width, 3) is blue, green, red, as OpenCV writes it.
    """
    cv2 = opencv()
    grey = photo if photo.ndim == 2 else cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)
    canvas = cv2.cvtColor(photo, cv2.COLOR_GRAY2BGR if photo.ndim == 2 else cv2.COLOR_RGB2BGR)
    thick = max(1, round(max(canvas.shape) / 640))
    for place in places:
        cv2.circle(canvas, _fixed(place), 3 * thick << _FINE, _PLACES, -1, cv2.LINE_AA, _FINE)
    named = {setting.tag, *(setting.tags_at.points if setting.tags_at is not None else ())}
    for tag in _all_tags(grey, setting):
        colour = _TIP if tag.number == setting.tag else _OTHER
        colour = _BOARD if tag.number in named - {setting.tag} else colour
        corners = np.round(tag.corners * 2**_FINE).astype(np.int32)
        cv2.polylines(canvas, [corners], True, colour, thick + 1, cv2.LINE_AA, _FINE)
        words = f"{tag.number}" if tag.number in named else f"{tag.number} ignored"
        at = tuple(int(v) for v in tag.corners.max(axis=0) + 4)
        cv2.putText(canvas, words, at, 0, 0.55 * thick, (20, 20, 20), 4 * thick, cv2.LINE_AA)
        cv2.putText(canvas, words, at, 0, 0.55 * thick, colour, thick, cv2.LINE_AA)
        if tag.number == setting.tag:
            cv2.drawMarker(
                canvas,
                tuple(np.round(tag.centre).astype(int).tolist()),
                colour,
                0,
                14 * thick,
                thick,
            )
    if setting.board is not None:
        for corner in BoardFinder(setting.board).find(grey).values():
            cv2.circle(
                canvas, _fixed(corner), 4 * thick << _FINE, _BOARD, thick, cv2.LINE_AA, _FINE
            )
    return np.asarray(canvas, np.uint8)


def write_seen(
    path: str | os.PathLike[str], photo: Picture, setting: Setting, places: Array
) -> None:
    """Write the drawing of `draw_seen` as PNG."""
    packed = opencv().imencode(".png", draw_seen(photo, setting, places))[1]
    atomic_write(path, packed.tobytes())


def _all_tags(grey: Picture, setting: Setting) -> list[Tag]:
    """Return the tags looked for as they were, and what else of the dictionary is there."""
    found = setting.finder.find(grey)
    known = [tag.centre for tag in found]
    for tag in TagFinder(setting.dictionary).find(grey):
        if not any(np.linalg.norm(tag.centre - centre) < 0.3 * tag.side for centre in known):
            found.append(tag)
    return found


def _fixed(place: Array) -> tuple[int, int]:
    return round(float(place[0]) * 2**_FINE), round(float(place[1]) * 2**_FINE)
