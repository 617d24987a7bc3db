"""A log from a video: clocks aligned, rows where the arm rests, or where it moves slowly."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..errors import LogError
from ..samples.joint_values import MAX_GAP, SETTLE, check_limits, covered, joint_speed, joints_at
from ..samples.recorded import Recorded
from .clocks import Clocks, align_clocks
from .from_pictures import assemble, check_motion, reference_of
from .joint_table import JointTable
from .pictures import Picture, Video
from .setting import LOOKS, Setup, sight
from .tags import LEAST_NOISE, Tag
from .track import jumps

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
    video, times, notes = Video(path), list[float](), list[str]()
    every = max(1, video.claimed // LOOKS) if 0 < video.claimed < 10**7 else 100
    seen = sight(_frames(video, times), setting, "frames", every, every)
    time, reasons = np.array(times), seen.reasons
    if video.claimed > 1.05 * len(time) + 2:
        notes.append(
            f"{video.name} claims {video.claimed} frames, {len(time)} can be read: it is cut off"
        )
    check_motion(q, seen, setting.tag, video.name)
    pixels = np.full((len(time), 2), np.nan)
    pixels[seen.numbers] = seen.pixels
    clocks = Clocks(time_offset or 0.0)
    if time_offset is None:
        clocks = align_clocks(time, pixels, joint_time, q, revolute)
        notes.append(clocks.words())
    when = clocks.joints_time(time)
    usable = np.isfinite(pixels[:, 0])
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
    slow = usable & (speed < (_REST if still is None else still))
    groups = [np.array([k]) for k in np.flatnonzero(slow)]
    if still is None:
        groups = _rests(when, pixels, slow)
        notes.append(f"{len(groups)} rests of {np.mean([0, *map(len, groups)]):.0f} frames")
    kind = "the arm moves" if still is None else f"a joint moves faster than {still:g}"
    reasons[kind] = int(usable.sum() - sum(map(len, groups)))
    if not groups:
        raise LogError(
            f"the arm never rests for {_LEAST} frames of {video.name}, or moves as slowly as "
            "`still`, the speed below which frames in motion are taken: record it with stops"
        )
    tag_of = dict(zip(seen.numbers.tolist(), seen.tags, strict=True))
    tags = [_middle([tag_of[k] for k in group.tolist()]) for group in groups]
    if still is not None:
        # a rolling shutter sees lower rows later; the clocks' offset takes the mean of that
        there = np.isfinite(pixels[:, 0])
        pace = np.linalg.norm(np.gradient(pixels[there], when[there], axis=0), axis=1)
        late = _SHUTTER * float(pixels[there, 1].std()) / seen.size[1] * pace / np.sqrt(2.0)
        more = np.interp(when[slow], when[there], late)
        tags = [
            replace(tag, noise=float(np.hypot(tag.noise, each)))
            for tag, each in zip(tags, more, strict=True)
        ]
        notes.append(
            f"frames in motion: the noise allows for a rolling shutter of {1e3 * _SHUTTER:g} ms, "
            "which would shift the tag; rests have no such error"
        )
    reference, _ = reference_of(setting, seen)
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


def _rests(when: Array, pixels: Array, still: Mask) -> list[Index]:
    """Return the frames of each rest: joints and tag stand still for `_LEAST` frames or more."""
    frames = np.flatnonzero(still)
    moved = np.linalg.norm(np.diff(pixels[frames], axis=0), axis=1) > _SHAKE
    rests = []
    for run in np.split(frames, np.flatnonzero(moved | (np.diff(when[frames]) > _PAUSE)) + 1):
        inside = (when[run] >= when[run[:1]] + SETTLE) & (when[run] <= when[run[-1:]] - SETTLE)
        if inside.sum() < _LEAST:
            continue
        # the arm may still swing where its joints stand: only frames near the median count
        settled = run[inside]
        away = np.linalg.norm(pixels[settled] - np.median(pixels[settled], axis=0), axis=1)
        if (away < _SHAKE).sum() >= _LEAST:
            rests.append(settled[away < _SHAKE])
    return rests


def _middle(tags: Sequence[Tag]) -> Tag:
    if len(tags) == 1:
        return tags[0]
    scatter = float(np.sqrt(np.mean(np.var([tag.centre for tag in tags], axis=0, ddof=1))))
    # a median scatters by 1.25 times what a mean does (normal noise)
    noise = max(LEAST_NOISE, 1.25 * scatter / float(np.sqrt(len(tags))))
    return replace(tags[0], corners=np.median([tag.corners for tag in tags], axis=0), noise=noise)
