"""A log from a video: clocks aligned, rows where the arm rests, or where it moves slowly."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Mask
from ..errors import LogError, OptionError
from ..samples.bags import MAX_GAP
from ..samples.joint_values import covered, joints_at
from .clocks import Clocks, align_clocks
from .from_pictures import assemble, unseen
from .joint_table import JointTable
from .recorded import Recorded, told
from .setting import Setup
from .tags import LEAST_NOISE, Tag
from .track import check_motion, jumps
from .video import follow_tag

_REST = 0.01  # a joint that moves slower rests [rad/s or m/s]
_LEAST = 3  # frames that a rest must have
_SETTLE = 0.04  # left out at either end of a rest [s]
_SHUTTER = 0.03  # that a rolling shutter takes from the first row to the last [s]
_SHAKE = 0.5  # a tag that moves more has not come to rest [px]


@dataclass(frozen=True)
class VideoRows:
    """Which frames become rows of a log."""

    time_offset: float | None = None  # added to the video's times; found if not given [s]
    # every frame in which no joint moves faster is a row; else the median of each rest is
    # [rad/s or m/s]
    still: float | None = None
    max_gap: float = MAX_GAP  # frames between joints further apart are left out [s]

    def __post_init__(self) -> None:
        if self.still is not None and not self.still > 0:
            raise OptionError(f"`still={self.still:g}`: expected a speed above zero [rad/s or m/s]")
        if not self.max_gap > 0:
            raise OptionError(f"`max_gap={self.max_gap:g}`: expected more than zero")


def log_video(
    path: str | os.PathLike[str],
    joints: JointTable,
    setting: Setup,
    rows: VideoRows | None = None,
    *,
    revolute: Sequence[bool] | None = None,
    since: Mapping[str, Any] | None = None,
) -> Recorded:
    """Make a log from a video, of any format that OpenCV opens; see `log_pictures`.

    The joints have times, by a clock of their own. `revolute` says which of them turn; all if it is
    not given.

    Raises LogError in one line, if no log can be made: no such tag, clocks that cannot be aligned,
        an arm that never rests, and the like.
    """
    rows = rows or VideoRows()
    if joints.time is None:
        raise LogError(f"{joints.label} has no times: a video needs a column 'time' [s]")
    # a stamp that is there twice has no speed: the first row counts
    joint_time, first = np.unique(joints.time, return_index=True)
    q = joints.q[first]
    if len(q) < 2:
        raise LogError(f"{joints.label} has one time only: expected the joints' motion")
    name = Path(path).name
    track = follow_tag(path, setting)
    pixels = track.pixels
    seen = np.isfinite(pixels[:, 0])
    if not seen.any():
        raise unseen(setting, track.sample, f"{len(pixels)} frames")
    check_motion(q, pixels[seen], setting.tag, name)
    notes = list(track.notes)
    clocks = Clocks(rows.time_offset or 0.0)
    if rows.time_offset is None:
        clocks = align_clocks(track.time, pixels, joint_time, q, revolute)
        notes.append(clocks.words())
    when = clocks.joints_time(track.time)
    usable, reasons = _usable(when, pixels, joint_time, rows.max_gap)
    reasons = {**track.reasons, **reasons}
    if not usable.any():
        raise LogError(
            f"the clocks are apart: the video runs from {when[0]:.2f} to {when[-1]:.2f} s of the "
            f"joints' clock, which has {joint_time[0]:.2f} to {joint_time[-1]:.2f} s; give another "
            "`time_offset`, or none to have it found"
        )
    there = joints_at(when, joint_time, q)
    speed = _speed(when, joint_time, q)
    if rows.still is None:
        groups = _rests(when, pixels, usable & (speed < _REST))
        if not groups:
            raise LogError(
                f"the arm never rests for {_LEAST} frames of {name}: record it with stops, or give "
                "`still`, the speed below which frames in motion are taken"
            )
        moving = int(usable.sum() - sum(map(len, groups)))
        reasons["the arm moves"] = moving
        notes.append(f"{len(groups)} rests of {np.mean([len(g) for g in groups]):.0f} frames")
    else:
        slow = usable & (speed < rows.still)
        reasons[f"a joint moves faster than {rows.still:g}"] = int((usable & ~slow).sum())
        groups = [np.array([k]) for k in np.flatnonzero(slow)]
        if not groups:
            raise LogError(f"no frame of {name} is slower than `still={rows.still:g}`")
    tags = [_middle([tag for k in g if (tag := track.tags[k]) is not None]) for g in groups]
    if rows.still is not None:
        late = _late(when, pixels, np.concatenate(groups), track.sample[0].shape[0])
        tags = [
            replace(tag, noise=float(np.hypot(tag.noise, more)))
            for tag, more in zip(tags, late, strict=True)
        ]
        notes.append(
            f"frames in motion: the noise allows for a rolling shutter of {1e3 * _SHUTTER:g} ms, "
            "which would shift the tag; rests have no such error"
        )
    watched = setting.watch(track.marks, since)
    time = np.array([np.median(when[g]) for g in groups])
    return assemble(
        setting,
        watched,
        tags,
        np.array([g[0] for g in groups]),
        joint_names=joints.names,
        q=np.array([there[g].mean(axis=0) for g in groups]),
        source={
            "source": "video",
            "size": list(track.sample[0].shape[1::-1]),
            "time_offset": clocks.offset,
            "rate": clocks.rate,
        },
        time=time - time[0],
        dropped={why: count for why, count in reasons.items() if count},
        notes=[*notes, *watched.notes, *told(reasons, "frames")],
    )


def _usable(
    when: Array, pixels: Array, joint_time: Array, max_gap: float
) -> tuple[Mask, dict[str, int]]:
    seen = np.isfinite(pixels[:, 0])
    jump = jumps(pixels)
    inside, close, _ = covered(when, joint_time, max_gap)
    return seen & ~jump & inside & close, {
        "a jump of the track": int(jump.sum()),
        "outside of the joints' times": int((seen & ~jump & ~inside).sum()),
        f"joints more than {max_gap:g} s apart": int((seen & ~jump & inside & ~close).sum()),
    }


def _late(when: Array, pixels: Array, frames: NDArray[np.intp], height: int) -> Array:
    """Return what a rolling shutter may shift frames in motion by (n,), along an axis [px].

    It sees lower rows later.  The clocks' offset takes the mean of that, not its spread.
    """
    seen = np.isfinite(pixels[:, 0])
    speed = np.linalg.norm(np.gradient(pixels[seen], when[seen], axis=0), axis=1) / np.sqrt(2.0)
    late = _SHUTTER * float(pixels[seen, 1].std()) / height
    return np.asarray(np.interp(when[frames], when[seen], late * speed))


def _speed(when: Array, joint_time: Array, q: Array) -> Array:
    """Return the fastest joint's speed about each time [rad/s or m/s]."""
    h = _SETTLE
    low, high = (joints_at(when + d, joint_time, q) for d in (-h, h))
    return np.asarray(np.abs(high - low).max(axis=1) / (2.0 * h))


def _rests(when: Array, pixels: Array, still: Mask) -> list[NDArray[np.intp]]:
    """Return the frames of each rest: joints and tag stand still for `_LEAST` frames or more."""
    groups: list[NDArray[np.intp]] = []
    run: list[int] = []
    for k in [*np.flatnonzero(still).tolist(), -1]:
        apart = not run or k < 0 or when[k] - when[run[-1]] > 0.25
        if run and (apart or np.linalg.norm(pixels[k] - np.median(pixels[run], axis=0)) > _SHAKE):
            groups += _trimmed(when, pixels, run)
            run = []
        if k >= 0:
            run.append(k)
    return groups


def _trimmed(when: Array, pixels: Array, run: list[int]) -> list[NDArray[np.intp]]:
    frames = np.array(run)
    inner = (when[frames] >= when[run[0]] + _SETTLE) & (when[frames] <= when[run[-1]] - _SETTLE)
    frames = frames[inner]
    if len(frames) < _LEAST:
        return []
    # the arm may still swing where its joints stand: only frames near the median count
    near = np.linalg.norm(pixels[frames] - np.median(pixels[frames], axis=0), axis=1) < _SHAKE
    return [frames[near]] if near.sum() >= _LEAST else []


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
