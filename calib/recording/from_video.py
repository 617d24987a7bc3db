"""A log from a video: clocks aligned, rows where the arm rests, or where it moves slowly."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Mask
from ..errors import LogError
from ..samples.joint_values import MAX_GAP, SETTLE, check_limits, covered, joint_speed, joints_at
from ..samples.recorded import Recorded
from .clocks import Clocks, align_clocks
from .from_pictures import assemble
from .joint_table import JointTable
from .opencv import Picture
from .pictures import Video
from .setting import Setup
from .sight import LOOKS, sight
from .tags import LEAST_NOISE, Tag
from .track import check_motion, jumps
from .watch import watch

_REST = 0.01  # a joint that moves slower rests [rad/s or m/s]
_LEAST = 3  # frames that a rest must have
_PAUSE = 0.25  # without the tag, that a rest may have [s]
_LEAST_FRAMES = 10  # a video of fewer frames is none
_SHUTTER = 0.03  # that a rolling shutter takes from the first row to the last [s]
_SHAKE = 0.5  # a tag that moves more has not come to rest [px]


def log_video(
    path: str | os.PathLike[str],
    joints: JointTable,
    setting: Setup,
    *,
    time_offset: float | None = None,
    still: float | None = None,
    max_gap: float = MAX_GAP,
    revolute: Sequence[bool] | None = None,
) -> Recorded:
    """Make a log from a video, of any format that OpenCV opens; see `log_pictures`.

    joints : with times, by a clock of their own
    time_offset : [s], added to the video's times; found if not given
    still : [rad/s or m/s], every frame in which no joint moves faster is a row; without it the
        median of each rest is
    max_gap : [s], frames between joints further apart are left out
    revolute : which joints turn; all if it is not given
    Raises LogError in one line, if no log can be made.
    """
    check_limits(max_gap, still)
    # a stamp that is there twice has no speed: the first row counts
    stamps = np.empty(0) if joints.time is None else joints.time
    joint_time, first = np.unique(stamps, return_index=True)
    if len(first) < 2:
        raise LogError(
            f"{joints.label} has {len(first)} times: a video needs the joints' motion, with a "
            "column 'time' [s]"
        )
    q = joints.q[first]
    video, times = Video(path), list[float]()
    every = max(1, video.claimed // LOOKS) if 0 < video.claimed < 10**7 else 100
    seen = sight(_frames(video, times), setting, "frames", every, looks=every)
    notes, time = list[str](), np.array(times)
    if video.claimed > 1.05 * len(time) + 2:
        notes.append(
            f"{video.name} claims {video.claimed} frames, {len(time)} can be read: it is cut off"
        )
    check_motion(q, seen.pixels, setting.tag, video.name)
    pixels = np.full((len(time), 2), np.nan)
    pixels[seen.numbers] = seen.pixels
    clocks = Clocks(time_offset or 0.0)
    if time_offset is None:
        clocks = align_clocks(time, pixels, joint_time, q, revolute)
        notes.append(clocks.words())
    when = clocks.joints_time(time)
    usable, reasons = np.isfinite(pixels[:, 0]), seen.reasons
    doubts = {"a jump of the track": jumps(pixels)} | covered(when, joint_time, max_gap)
    for why, wrong in doubts.items():
        reasons[why] = int((usable & wrong).sum())
        usable &= ~wrong
    if not usable.any():
        raise LogError(
            f"the clocks are apart: the video runs from {when[0]:.2f} to {when[-1]:.2f} s of the "
            f"joints' clock, which has {joint_time[0]:.2f} to {joint_time[-1]:.2f} s; give another "
            "`time_offset`, or none to have it found"
        )
    speed = joint_speed(when, joint_time, q)
    if still is None:
        groups = _rests(when, pixels, usable & (speed < _REST))
        reasons["the arm moves"] = int(usable.sum() - sum(map(len, groups)))
        if groups:
            notes.append(f"{len(groups)} rests of {np.mean([*map(len, groups)]):.0f} frames")
    else:
        slow = usable & (speed < still)
        reasons[f"a joint moves faster than {still:g}"] = int((usable & ~slow).sum())
        groups = [np.array([k]) for k in np.flatnonzero(slow)]
    if not groups:
        raise LogError(
            f"the arm never rests for {_LEAST} frames of {video.name}, or moves as slowly as "
            "`still`, the speed below which frames in motion are taken: record it with stops"
        )
    tag_of = dict(zip(seen.numbers.tolist(), seen.tags, strict=True))
    tags = [_middle([tag_of[k] for k in group.tolist()]) for group in groups]
    if still is not None:
        late = _late(when, pixels, np.concatenate(groups), seen.size[1])
        tags = [
            replace(tag, noise=float(np.hypot(tag.noise, more)))
            for tag, more in zip(tags, late, strict=True)
        ]
        notes.append(
            f"frames in motion: the noise allows for a rolling shutter of {1e3 * _SHUTTER:g} ms, "
            "which would shift the tag; rests have no such error"
        )
    reference, _ = watch(setting.layout, seen.marks, setting.lens, setting.tag_height)
    there = joints_at(when, joint_time, q)
    rows = np.array([np.median(when[g]) for g in groups])
    return assemble(
        setting,
        reference,
        tags,
        reasons,
        "frames",
        joint_names=joints.names,
        q=np.array([there[g].mean(axis=0) for g in groups]),
        source={"source": "video", "size": list(seen.size), "time_offset": clocks.offset,
                "rate": clocks.rate},
        time=rows - rows[0],
        notes=notes,
    )  # fmt: skip


def _frames(video: Video, times: list[float]) -> Iterator[tuple[int, str, Picture]]:
    """Yield numbers, names and grey frames of a video, and note their times [s]."""
    for number, (time, grey) in enumerate(video.frames()):
        times.append(time)
        yield number, f"{video.name} at {time:.1f} s", grey
    if len(times) < _LEAST_FRAMES:
        raise LogError(
            f"{video.name} has {len(times)} frames that can be read, {_LEAST_FRAMES} expected: is "
            "it a video?"
        )


def _late(when: Array, pixels: Array, frames: NDArray[np.intp], height: int) -> Array:
    """Return what a rolling shutter may shift frames in motion by (n,), along an axis [px].

    It sees lower rows later.  The clocks' offset takes the mean of that, not its spread.
    """
    seen = np.isfinite(pixels[:, 0])
    speed = np.linalg.norm(np.gradient(pixels[seen], when[seen], axis=0), axis=1) / np.sqrt(2.0)
    late = _SHUTTER * float(pixels[seen, 1].std()) / height
    return np.asarray(np.interp(when[frames], when[seen], late * speed))


def _rests(when: Array, pixels: Array, still: Mask) -> list[NDArray[np.intp]]:
    """Return the frames of each rest: joints and tag stand still for `_LEAST` frames or more."""
    frames = np.flatnonzero(still)
    moved = np.linalg.norm(np.diff(pixels[frames], axis=0), axis=1) > _SHAKE
    rests = []
    for run in np.split(frames, np.flatnonzero(moved | (np.diff(when[frames]) > _PAUSE)) + 1):
        settled = run[
            (when[run] >= when[run[:1]] + SETTLE) & (when[run] <= when[run[-1:]] - SETTLE)
        ]
        if len(settled) < _LEAST:
            continue
        # the arm may still swing where its joints stand: only frames near the median count
        away = np.linalg.norm(pixels[settled] - np.median(pixels[settled], axis=0), axis=1)
        if (away < _SHAKE).sum() >= _LEAST:
            rests.append(settled[away < _SHAKE])
    return rests


def _middle(tags: Sequence[Tag]) -> Tag:
    if len(tags) == 1:
        return tags[0]
    centres = np.array([tag.centre for tag in tags])
    scatter = float(np.sqrt(np.mean(np.var(centres, axis=0, ddof=1))))
    return replace(
        tags[0],
        corners=np.median([tag.corners for tag in tags], axis=0),
        centre=np.median(centres, axis=0),
        # a median scatters by 1.25 times what a mean does (normal noise)
        noise=max(LEAST_NOISE, 1.25 * scatter / float(np.sqrt(len(tags)))),
    )
