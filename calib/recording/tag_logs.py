"""Logs from pictures, one posture each, and from videos, where the arm rests or moves slowly."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.rotations import quaternion_of
from ..common.arrays import Array, Index, Mask
from ..common.parallel import one_blas_thread
from ..errors import LogError
from ..samples.motion import (
    MAX_GAP,
    SETTLE,
    check_limits,
    gaps_between,
    joint_speed,
    joints_at,
)
from ..samples.samples import Samples
from .clocks import Clocks, align_clocks
from .motion_tables import JointTable, read_shots
from .pictures import Frame, Video
from .reference import find_pose, matrices
from .rigid import shift_of, turn_of
from .setting import LOOKS, Setup, Sightings, sight
from .tags import LEAST_NOISE, Tag
from .track import jumps, row_shift


@dataclass(frozen=True)
class RestSettings:
    """When an arm and its tag rest."""

    # [px]; a tag that moves less over a recording does not move
    still: float = 2.0
    # a joint that moves slower rests [rad/s or m/s]
    rest: float = 0.01
    # frames that a rest must have
    least: int = 3
    # without the tag, that a rest may have [s]
    pause: float = 0.25
    # a tag that moves more has not come to rest [px]
    shake: float = 0.5


REST = RestSettings()


def log_pictures(
    source: str | os.PathLike[str] | Sequence[str],
    joints: JointTable,
    setting: Setup,
) -> Samples:
    """Make a log from pictures of an arm with a printed tag on its tip.

    source : a folder, a pattern such as `shots/*.jpg`, or several names
    joints : one row for each picture, by their column of names or in natural order
    Raises LogError in one line, if no log can be made.
    """
    rows, frames, notes = read_shots(joints, source)
    sightings = sight(frames, setting, "pictures")
    sightings.reasons["cut off or damaged"] = len(rows) - sightings.count
    q = joints.q[[rows[number] for number in sightings.numbers]]
    if len(q) > 1:
        _check_motion(q, sightings, f"{len(q)} pictures")
    with one_blas_thread():
        shift, unshifted, other = row_shift(q, sightings.pixels)
    if shift:
        raise LogError(
            f"the joints are shifted against the pictures: those {abs(shift)} rows further "
            f"{'down' if shift > 0 else 'up'} predict the tag to {other:.2g} px, a picture's own "
            f"to {unshifted:.2g} px; is a picture missing?"
        )
    # rows that contradict the others, as a second tag makes them, are found by who learns from them
    steady = np.flatnonzero(
        ~np.isin(sightings.numbers, list(sightings.reference[1]))
    )
    reason = (
        "the reference is elsewhere in them: camera bumped, shaken, refocused?"
    )
    sightings.reasons[reason] = len(q) - len(steady)
    return _samples_of(
        sightings,
        [sightings.tags[k] for k in steady],
        notes,
        {"source": "pictures"},
        joint_names=joints.names,
        q=q[steady],
        pictures=np.array(sightings.names)[steady],
    )


def log_video(
    path: str | os.PathLike[str],
    joints: JointTable,
    setting: Setup,
    *,
    time_offset: float | None = None,
    still: float | None = None,
    max_gap: float = MAX_GAP,
    revolute: Sequence[bool] | None = None,
) -> Samples:
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
            f"{joints.label} has {len(first)} times: expected a column 'time' [s]"
        )
    q = joints.q[first]
    video = Video(path)
    times = list[float]()
    notes = list[str]()

    def frames() -> Iterator[Frame]:
        for number, (stamp, grey) in enumerate(video.frames()):
            times.append(stamp)
            yield number, f"{video.name} at {stamp:.1f} s", grey

    every = max(1, video.claimed // LOOKS) if 0 < video.claimed < 10**7 else 100
    sightings = sight(frames(), setting, "frames", every)
    time = np.array(times)
    reasons = sightings.reasons
    if video.claimed > 1.05 * len(time) + 2:
        notes.append(
            f"{len(time)} of {video.claimed} frames can be read: it is cut off"
        )
    _check_motion(q, sightings, video.name)
    pixels = np.full((len(time), 2), np.nan)
    pixels[sightings.numbers] = sightings.pixels
    clocks = Clocks(time_offset or 0.0)
    if time_offset is None:
        clocks = align_clocks(time, pixels, joint_time, q, revolute)
        notes.append(clocks.words())
    when = clocks.joints_time(time)
    usable = np.isfinite(pixels[:, 0])
    doubts = {"a jump of the track": jumps(pixels)} | gaps_between(
        when, joint_time, max_gap
    )
    for why, wrong in doubts.items():
        reasons[why] = int((usable & wrong).sum())
        usable &= ~wrong
    if not usable.any():
        raise LogError(
            f"the clocks are apart: the video runs from {when[0]:.2f} to {when[-1]:.2f} s of the "
            f"joints' clock, which has {joint_time[0]:.2f} to {joint_time[-1]:.2f} s"
        )
    slow = usable & (
        joint_speed(when, joint_time, q)
        < (REST.rest if still is None else still)
    )
    if still is None:
        groups = _rests(when, pixels, slow)
        kind = "the arm moves"
        notes.append(
            f"{len(groups)} rests of {np.mean([0, *map(len, groups)]):.0f} frames"
        )
    else:
        groups = list(np.flatnonzero(slow)[:, None])
        kind = f"a joint moves faster than {still:g}"
    reasons[kind] = int(usable.sum() - sum(map(len, groups)))
    if not groups:
        raise LogError(
            f"the arm never rests for {REST.least} frames of {video.name}, or moves as slowly as "
            "`still`: record it with stops"
        )
    tag_of = dict(zip(sightings.numbers, sightings.tags, strict=True))
    there = joints_at(when, joint_time, q)
    rows = np.array([np.median(when[group]) for group in groups])
    return _samples_of(
        sightings,
        [_middle([tag_of[k] for k in group]) for group in groups],
        notes,
        {"source": "video", "time_offset": clocks.offset, "rate": clocks.rate},
        joint_names=joints.names,
        q=np.array([there[g].mean(axis=0) for g in groups]),
        time=rows - rows[0],
    )


def _rests(when: Array, pixels: Array, still: Mask) -> list[Index]:
    """Return the frames of each rest: joints and tag stand still for a few frames."""
    frames = np.flatnonzero(still)
    moved = np.linalg.norm(np.diff(pixels[frames], axis=0), axis=1) > REST.shake
    rests = []
    for run in np.split(
        frames, np.flatnonzero(moved | (np.diff(when[frames]) > REST.pause)) + 1
    ):
        first = when[run[:1]] + SETTLE
        last = when[run[-1:]] - SETTLE
        settled = run[(when[run] >= first) & (when[run] <= last)]
        if len(settled) >= REST.least:
            # the arm may still swing where its joints stand: only frames near the median count
            away = np.linalg.norm(
                pixels[settled] - np.median(pixels[settled], axis=0), axis=1
            )
            rests.append(settled[away < REST.shake])
    return [rest for rest in rests if len(rest) >= REST.least]


def _middle(tags: Sequence[Tag]) -> Tag:
    if len(tags) == 1:
        return tags[0]
    scatter = float(
        np.sqrt(np.mean(np.var([tag.centre for tag in tags], axis=0, ddof=1)))
    )
    # a median scatters by 1.25 times what a mean does (normal noise)
    noise = max(LEAST_NOISE, 1.25 * scatter / float(np.sqrt(len(tags))))
    return replace(
        tags[0],
        corners=np.median([tag.corners for tag in tags], axis=0),
        noise=noise,
    )


def _check_motion(q: Array, sightings: Sightings, what: str) -> None:
    """Raise LogError for a recording in which the arm, or the tag alone, stands still."""
    if np.ptp(q, axis=0).max() < 2e-3:
        raise LogError(f"the arm never moves in {what}: nothing to learn from")
    if np.linalg.norm(np.ptp(sightings.pixels, axis=0)) < REST.still:
        u, v = np.median(sightings.pixels, axis=0)
        raise LogError(
            f"tag {sightings.setting.tag} stays at ({u:.0f}, {v:.0f}) px in all of {what} while "
            "the joints move: check that it is on the tip and that no second tag of this id is in "
            "view"
        )


def _samples_of(
    sightings: Sightings,
    tags: Sequence[Tag],
    notes: list[str],
    about: dict[str, object],
    **more: Any,
) -> Samples:
    """Put a log together from the tags of some pictures, and why others have none."""
    setting = sightings.setting
    reference = sightings.reference[0]
    pixels = np.array([tag.centre for tag in tags])
    x = pixels
    unit = "px"
    quaternion = None
    scale = np.ones(1)
    common = np.zeros(1)
    about |= {
        "size": list(sightings.size),
        "tag": setting.tag,
        "dictionary": setting.dictionary,
        "reference": {"kind": "pixels"},
    }
    if reference is not None:
        x = reference.positions(pixels)
        unit = "m"
        scale, common = reference.noise(pixels)
        about["reference"] = reference.to_json()
    lens = setting.lens
    size = setting.tag_size
    if lens is not None:
        about["lens"] = lens.to_json()
    if lens is not None and size is not None:
        # the tag's frame: origin in the middle, x to the right, y up, z out of the paper
        corners = [[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]
        square = 0.5 * size * np.array(corners)
        places = matrices([find_pose(lens, square, t.corners) for t in tags])
        turns = turn_of(places)
        x = shift_of(places)
        if reference is None:
            scale = x[:, 2] / lens.focal.mean()
        else:
            frame = reference.pose.rotation
            turns = frame.T @ turns
            x = (x - reference.pose.shift) @ frame
        quaternion = quaternion_of(turns)
        unit = "m"
    shared = float(np.sqrt(np.mean(common**2)))
    noise = np.array([tag.noise for tag in tags]) * scale
    dropped = {why: count for why, count in sightings.reasons.items() if count}
    notes = notes + [
        f"{count} {sightings.what} left out: {why}"
        for why, count in dropped.items()
    ]
    rms = np.sqrt(np.mean(noise**2))
    about["noise"] = float(np.hypot(rms, shared))
    about["noise_of_reference"] = shared
    about["dropped"] = dropped
    return Samples(
        x=x,
        unit=unit,
        pixels=pixels,
        source=about,
        orientation=quaternion,
        notes=tuple(notes),
        **more,
    )
