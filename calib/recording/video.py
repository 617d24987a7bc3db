"""Frames of a video with their times, and the tag tracked through them."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..errors import LogError
from .board import BoardFinder
from .opencv import Picture, opencv
from .setting import Setup
from .tags import Tag
from .track import TipTags
from .watch import Marks

_LEAST_FRAMES = 10  # a video of fewer frames is none
_WHOLE = 30  # frames between searches of the whole picture: a window misses a second tag
_MARKS = 12  # looks at the reference over a video, about


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
        self.size = (
            int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )
        self.claimed = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self.rate = float(self._capture.get(cv2.CAP_PROP_FPS))

    def frames(self) -> Iterator[tuple[float, Picture]]:
        """Yield times [s] and grey frames."""
        cv2 = opencv()
        number = 0
        last = -np.inf
        while True:
            there, frame = self._capture.read()
            if not there or frame is None:
                break
            stamp = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            if not stamp > last:  # a file without times: its rate must do
                stamp = max(last, 0.0) + 1.0 / self.rate if self.rate > 0 and number else 0.0
            last = stamp
            number += 1
            grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
            yield stamp, grey
        self._capture.release()


@dataclass(frozen=True, eq=False)
class TagTrack:
    """The tag through a video."""

    # time, tags: times of the frames, by the camera's clock, and the tag in each (n,) [s]
    time: Array
    tags: tuple[Tag | None, ...]
    # frames in which the reference was looked for, and what they show
    marks: tuple[tuple[int, Marks], ...]
    reasons: Counter[str]  # why frames have no tag, and how many
    notes: tuple[str, ...]
    sample: tuple[Picture, ...]  # a few frames (height, width)

    @property
    def pixels(self) -> Array:
        """Places (n, 2) of the tag's centre, NaN where it was not seen [px]."""
        unseen = np.full(2, np.nan)
        return np.array([unseen if tag is None else tag.centre for tag in self.tags])


def follow_tag(path: str | os.PathLike[str], setting: Setup) -> TagTrack:
    """Track the tag of a setting through a video, within a window where it was just seen.

    Raises LogError if the file is no video, or the tag is there twice.
    """
    video = Video(path)
    setting.check_size(video.name, video.size)
    boards = BoardFinder(setting.board) if setting.board is not None else None
    every = max(1, video.claimed // _MARKS) if 0 < video.claimed < 10**7 else 100
    times: list[float] = []
    tags: list[Tag | None] = []
    marks: list[tuple[int, Marks]] = []
    sample: list[Picture] = []
    tips = TipTags(setting.tag)
    before: Tag | None = None
    speed = np.zeros(2)
    for number, (time, grey) in enumerate(video.frames()):
        look = setting.layout is not None and number % every == 0
        window = None
        if before is not None and number % _WHOLE and not (look and boards is None):
            window = _window(before, speed, grey.shape)
        found = setting.finder.find(grey, window)
        if window is not None and not any(t.number == setting.tag for t in found):
            found = setting.finder.find(grey)
        now, sharp = tips.pick(found, time)
        if look:
            marks.append((number, setting.marks(grey, found, boards)))
        if number % every == 0 and len(sample) < _MARKS:
            sample.append(grey)
        # without a tag in both frames nothing is known of its speed
        speed = now.centre - before.centre if now is not None and before is not None else 0 * speed
        before = now
        times.append(time)
        tags.append(sharp)
    if len(times) < _LEAST_FRAMES:
        raise LogError(
            f"{video.name} has {len(times)} frames that can be read, {_LEAST_FRAMES} expected: is "
            "it a video?"
        )
    at = "".join(f", such as at {time:.1f} s" for time in tips.twice[:1])
    tips.check_single(f"{video.name}{at}")
    notes = []
    if video.claimed > 1.05 * len(times) + 2:
        notes.append(
            f"{video.name} claims {video.claimed} frames, {len(times)} can be read: it is cut off"
        )
    return TagTrack(
        np.array(times), tuple(tags), tuple(marks), tips.reasons, tuple(notes), tuple(sample)
    )


def _window(tag: Tag, speed: Array, shape: tuple[int, ...]) -> tuple[int, int, int, int] | None:
    """Return where the tag may be in the next frame [px]; None if that is most of it."""
    half = 1.3 * tag.side + 2.0 * np.abs(speed) + 24.0
    low = np.maximum(np.floor(tag.centre + speed - half), 0).astype(int)
    high = np.minimum(np.ceil(tag.centre + speed + half), shape[1::-1]).astype(int)
    if (high - low < 16).any() or np.prod((high - low) / shape[1::-1]) > 0.6:
        return None
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])
