"""Logs from pictures, one posture each, and from videos, where the arm rests or moves slowly."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from ..arm.rigid import inverse, shift_of, turn_of
from ..arm.rotations import quaternion_of
from ..common.arrays import Array, Index, Mask
from ..common.atomic import FilePath
from ..common.parallel import one_blas_thread
from ..common.rows import rms, row_lengths
from ..errors import LogError
from ..samples.lens import Lens
from ..samples.motion import (
    MAX_GAP,
    SETTLE,
    check_limits,
    gaps_between,
    joint_speed,
    joints_at,
    rows_of_motion,
)
from ..samples.samples import Samples
from .clocks import Clocks, align_clocks
from .motion_tables import JointTable, read_shots
from .pictures import Shot, Video
from .reference import find_pose, frames_of
from .setting import LOOKS, Setting, Sightings, find_sightings
from .tags import LEAST_NOISE, Tag
from .track import jumps, left_out_notes, row_shift, usable_rows


@dataclass(frozen=True)
class RestSettings:
    """When an arm and its tag rest."""

    # a tag that moves less over a recording does not move [px]
    still: float = 2.0
    # a joint that moves slower rests [rad/s or m/s]
    rest: float = 0.01
    # frames that a rest has at least
    least: int = 3
    # longest time without the tag within a rest [s]
    pause: float = 0.25
    # a tag that moves more has not come to rest [px]
    shake: float = 0.5


REST = RestSettings()


def log_pictures(
    source: FilePath | Sequence[str],
    joints: JointTable,
    setting: Setting,
) -> Samples:
    """Make a log from pictures of an arm with a printed tag on its tip.

    source : a folder, a pattern such as `shots/*.jpg`, or several names
    joints : one row for each picture, by their column of names or in natural order
    Raises LogError in one line, if no log can be made.
    """
    rows, shots, notes = read_shots(joints, source)
    sightings = find_sightings(shots, setting, "pictures")
    q = joints.q[[rows[number] for number in sightings.tags]]
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
    _, elsewhere = sightings.reference
    steady = [number not in elsewhere for number in sightings.tags]
    why = (
        "the reference is elsewhere in them: camera bumped, shaken, refocused?"
    )
    dropped = {
        **sightings.reasons,
        "cut off or damaged": len(rows) - sightings.count,
        why: steady.count(False),
    }
    tags = [*compress(sightings.tags.values(), steady)]
    about: dict[str, object] = {"source": "pictures"}
    log = _log_of(sightings, tags, joints.names, q[steady], about, dropped)
    names = np.array(sightings.names)[steady]
    return replace(log, pictures=names, notes=(*notes, *log.notes))


def log_video(
    path: FilePath,
    joints: JointTable,
    setting: Setting,
    *,
    time_offset: float | None = None,
    still: float | None = None,
    max_gap: float = MAX_GAP,
) -> Samples:
    """Make a log from a video, of any format that FFmpeg (PyAV) reads; see `log_pictures`.

    joints : with times, by their own clock
    time_offset : [s], added to the video's times; found if not given
    still : [rad/s or m/s], every frame in which no joint moves faster is a row; without it the
        median of each rest is
    max_gap : [s], frames between joints further apart are left out
    Raises LogError in one line, if no log can be made.
    """
    check_limits(max_gap, still)
    video = Video(path)
    joint_time, joint_values = _motion_of(joints)
    sightings, time = _video_sightings(video, setting)
    _check_motion(joint_values, sightings, video.name)
    track = np.full((len(time), 2), np.nan)
    track[[*sightings.tags]] = sightings.pixels
    notes = video.notes(len(time))

    # joints at the frames
    clocks = Clocks(time_offset or 0.0)
    if time_offset is None:
        clocks = align_clocks(
            time, track, joint_time, joint_values, joints.revolute
        )
        notes.append(clocks.words())
    when = clocks.joints_time(time)
    q = joints_at(when, joint_time, joint_values)
    speed = joint_speed(when, joint_time, joint_values)
    doubts = {
        "a jump of the track": jumps(track),
        **gaps_between(when, joint_time, max_gap),
    }
    usable, dropped = usable_rows(np.isfinite(track[:, 0]), doubts)
    if not usable.any():
        raise LogError(
            f"the clocks are apart: the video runs from {when[0]:.2f} to {when[-1]:.2f} s of the "
            f"joints' clock, which has {joint_time[0]:.2f} to {joint_time[-1]:.2f} s"
        )

    # frames of each row
    slow = usable & (speed < (still or REST.rest))
    if still is None:
        groups = _rests(when, track, slow)
        why = "the arm moves"
    else:
        groups = list(np.flatnonzero(slow)[:, None])
        why = f"a joint moves faster than {still:g}"
    if not groups:
        raise LogError(
            f"the arm never rests for {REST.least} frames of {video.name}, or moves as slowly as "
            "`still`: record it with stops"
        )
    frames = sum(map(len, groups))
    if still is None:
        mean = frames / len(groups)
        notes.append(f"{len(groups)} rests of {mean:.0f} frames")

    # tag, joints and time of each row
    tags = [_median_tag([sightings.tags[k] for k in group]) for group in groups]
    about: dict[str, object] = {
        "source": "video",
        "time_offset": clocks.offset,
        "rate": clocks.rate,
    }
    moving = int(usable.sum()) - frames
    dropped = {**sightings.reasons, **dropped, why: moving}
    q = np.array([q[group].mean(axis=0) for group in groups])
    log = _log_of(sightings, tags, joints.names, q, about, dropped)
    row_time = np.array([np.median(when[group]) for group in groups])
    row_time -= row_time[0]
    return replace(log, time=row_time, notes=(*notes, *log.notes))


def _rests(when: Array, track: Array, slow: Mask) -> list[Index]:
    """The frames of each rest: joints and tag do not move for a few frames.

    when : (n,) [s];  track : (n, 2), the tag [px];  slow : (n,), frames in which no joint moves
    """
    frames = np.flatnonzero(slow)
    steps = row_lengths(np.diff(track[frames], axis=0))
    is_end = (steps > REST.shake) | (np.diff(when[frames]) > REST.pause)
    rests = []
    for run in np.split(frames, np.flatnonzero(is_end) + 1):
        first = when[run[:1]] + SETTLE
        last = when[run[-1:]] - SETTLE
        settled = run[(when[run] >= first) & (when[run] <= last)]
        if len(settled) >= REST.least:
            # the arm may still swing while its joints rest: only frames near the median count
            places = track[settled]
            away = places - np.median(places, axis=0)
            rests.append(settled[row_lengths(away) < REST.shake])
    return [rest for rest in rests if len(rest) >= REST.least]


def _motion_of(joints: JointTable) -> tuple[Array, Array]:
    """Times (m,) [s] in rising order and the joints (m, dof) at them.

    A time that is there twice has no speed: its first row counts.
    """
    stamps = np.empty(0) if joints.time is None else joints.time
    time, first = np.unique(stamps, return_index=True)
    if len(first) < 2:
        raise LogError(
            f"{joints.label} has {len(first)} times: expected a column 'time' [s]"
        )
    q = joints.q[first]
    rows = rows_of_motion(time, q)
    return time[rows], q[rows]


def _video_sightings(video: Video, setting: Setting) -> tuple[Sightings, Array]:
    """What a video's frames show, and the times (n,) [s] of all n frames."""
    times: list[float] = []

    def frames() -> Iterator[Shot]:
        for number, (stamp, grey) in enumerate(video.frames()):
            times.append(stamp)
            yield number, f"{video.name} at {stamp:.1f} s", grey

    every = 100
    if 0 < video.claimed < 10**7:
        every = max(1, video.claimed // LOOKS)
    sightings = find_sightings(frames(), setting, "frames", every)
    return sightings, np.array(times)


def _median_tag(tags: Sequence[Tag]) -> Tag:
    """The tag of a rest, by the median of each corner, with the noise of that median."""
    if len(tags) == 1:
        return tags[0]
    scatter = rms(np.std([tag.centre for tag in tags], axis=0, ddof=1))
    # a median scatters by 1.25 times what a mean does (normal noise)
    noise = 1.25 * scatter / float(np.sqrt(len(tags)))
    corners = np.median([tag.corners for tag in tags], axis=0)
    return replace(tags[0], corners=corners, noise=max(LEAST_NOISE, noise))


def _check_motion(q: Array, sightings: Sightings, what: str) -> None:
    """Raise LogError for a recording in which the arm, or the tag alone, does not move."""
    if np.ptp(q, axis=0).max() < 2e-3:
        raise LogError(f"the arm never moves in {what}: nothing to learn from")
    if np.linalg.norm(np.ptp(sightings.pixels, axis=0)) < REST.still:
        u, v = np.median(sightings.pixels, axis=0)
        raise LogError(
            f"tag {sightings.setting.tag} stays at ({u:.0f}, {v:.0f}) px in all of {what} while "
            "the joints move: check that it is on the tip and that no second tag of this id is in "
            "view"
        )


def _log_of(
    sightings: Sightings,
    tags: Sequence[Tag],
    joint_names: tuple[str, ...],
    q: Array,
    about: dict[str, object],
    dropped: Mapping[str, int],
) -> Samples:
    """The log of tags at joints (n, dof), with notes of why pictures have none.

    about : how they were recorded
    """
    setting = sightings.setting
    reference, _ = sightings.reference
    pixels = np.array([tag.centre for tag in tags])
    x = pixels
    unit = "px"
    scale = np.ones(1)  # size of a pixel [unit/px]
    shared_sd = 0.0  # of what all rows share [unit]
    quaternion = None
    if reference is not None:
        unit = "m"
        x = reference.positions(pixels)
        scale, sd = reference.noise(pixels)
        shared_sd = rms(sd)
    if setting.lens is not None and setting.tag_size is not None:
        # by each tag alone, in the reference's frame or the camera's
        unit = "m"
        frames = _tag_frames(tags, setting.lens, setting.tag_size)
        if reference is None:
            scale = shift_of(frames)[:, 2] / setting.lens.focal.mean()
        else:
            frames = inverse(reference.pose.frame) @ frames
        x = shift_of(frames)
        quaternion = quaternion_of(turn_of(frames))
    noise = np.array([tag.noise for tag in tags]) * scale
    dropped = {why: count for why, count in dropped.items() if count}
    source = {
        **about,
        **sightings.document(),
        "noise": math.hypot(rms(noise), shared_sd),
        "noise_of_reference": shared_sd,
        "dropped": dropped,
    }
    return Samples(
        q,
        x,
        joint_names,
        unit=unit,
        pixels=pixels,
        source=source,
        orientation=quaternion,
        notes=left_out_notes(sightings.what, dropped),
    )


def _tag_frames(tags: Sequence[Tag], lens: Lens, side: float) -> Array:
    """Frames (n, 4, 4) [m] of tags of a side [m] before the camera.

    Their origin is in the middle, x to the right, y up, z out of the paper.
    """
    corners = [[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]
    square = 0.5 * side * np.array(corners)
    return frames_of([find_pose(lens, square, tag.corners) for tag in tags])
