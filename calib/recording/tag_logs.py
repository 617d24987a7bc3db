"""Logs from pictures, one posture each, and from videos, where the arm rests or moves slowly."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from ..arm.rigid import inverse, shift_of, turn_of
from ..arm.rotations import quaternion_of
from ..common.arrays import Array, Document, Index, Mask
from ..common.atomic import FilePath
from ..common.parallel import one_blas_thread
from ..common.rows import rms, row_lengths
from ..errors import LogError
from ..samples.lens import Lens
from ..samples.motion import (
    MAX_GAP,
    SETTLE,
    check_limits,
    joint_speed,
    joints_at,
    rows_of_motion,
    unknown_times,
)
from ..samples.samples import Samples
from .clocks import Clocks, align_clocks
from .motion_tables import JointTable, read_shots
from .pictures import Shot, Video
from .reference import find_pose, frames_of
from .tag_scene import LOOKS, Sightings, TagScene, find_sightings
from .tags import LEAST_NOISE, Tag
from .track import jumps, left_out_notes, row_shift, usable_rows


@dataclass(frozen=True)
class TagRestSettings:
    """When an arm and its tag rest."""

    # least motion of a tag over a recording [px]
    still: float = 2.0
    # speed below which a joint rests [rad/s or m/s]
    rest: float = 0.01
    # frames that a rest has at least
    least: int = 3
    # longest time without the tag within a rest [s]
    pause: float = 0.25
    # motion above which a tag has not come to rest [px]
    shake: float = 0.5


TAG_REST = TagRestSettings()


@dataclass(frozen=True, eq=False)
class TagReadings:
    """What the tags of a log measure."""

    x: Array  # (n, m) [unit]
    unit: str
    pixel_size: Array  # (n,) [unit/px]
    shared_sd: float = 0.0  # sd of an error that all rows share [unit]
    quaternion: Array | None = None  # (n, 4), of the tag


def log_pictures(
    source: FilePath | Sequence[str],
    joints: JointTable,
    scene: TagScene,
) -> Samples:
    """Make a log from pictures of an arm with a printed tag on its tip.

    source : a folder, a pattern such as `shots/*.jpg`, or several names
    joints : one row for each picture, by their column of names or in natural order
    Raises LogError in one line, if no log can be made.
    """
    rows, shots, notes = read_shots(joints, source)
    sightings = find_sightings(shots, scene, "pictures")
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
    # rows that contradict the others, such as those of a second tag, are left out in training
    _, elsewhere = sightings.reference
    steady = [number not in elsewhere for number in sightings.tags]
    dropped = {
        **sightings.reasons,
        "cut off or damaged": len(rows) - sightings.count,
        "the reference is elsewhere in them: camera bumped, shaken, refocused?": steady.count(
            False
        ),
    }
    tags = [*compress(sightings.tags.values(), steady)]
    about = {"source": "pictures"}
    log = _log_of(sightings, tags, joints.names, q[steady], about, dropped)
    names = np.array(sightings.names)[steady]
    return replace(log, pictures=names, notes=(*notes, *log.notes))


def log_video(
    path: FilePath,
    joints: JointTable,
    scene: TagScene,
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
    sightings, time = _video_sightings(video, scene)
    _check_motion(joint_values, sightings, video.name)
    track = np.full((len(time), 2), np.nan)
    track[[*sightings.tags]] = sightings.pixels
    notes = video.notes(len(time))

    # joints at the frames
    if time_offset is None:
        clocks = align_clocks(
            time, track, joint_time, joint_values, joints.revolute
        )
        notes.append(clocks.words())
    else:
        clocks = Clocks(time_offset)
    when = clocks.joints_time(time)
    q = joints_at(when, joint_time, joint_values)
    usable, dropped = _usable_frames(when, track, joint_time, max_gap)

    # frames of each row
    speed = joint_speed(when, joint_time, joint_values)
    slow = usable & (speed < (still or TAG_REST.rest))
    if still is None:
        groups = _rests(when, track, slow)
        why = "the arm moves"
    else:
        groups = list(np.flatnonzero(slow)[:, None])
        why = f"a joint moves faster than {still:g}"
    if not groups:
        raise LogError(
            f"the arm never rests for {TAG_REST.least} frames of {video.name}, or moves as slowly "
            "as `still`: record it with stops"
        )
    frames = sum(map(len, groups))
    if still is None:
        mean = frames / len(groups)
        notes.append(f"{len(groups)} rests of {mean:.0f} frames")
    moving = int(usable.sum()) - frames
    dropped = {**sightings.reasons, **dropped, why: moving}

    # tag, joints and time of each row
    tags = [_median_tag([sightings.tags[k] for k in group]) for group in groups]
    q = np.array([q[group].mean(axis=0) for group in groups])
    about = {
        "source": "video",
        "time_offset": clocks.offset,
        "rate": clocks.rate,
    }
    log = _log_of(sightings, tags, joints.names, q, about, dropped)
    row_time = np.array([np.median(when[group]) for group in groups])
    notes += log.notes
    return replace(log, time=row_time - row_time[0], notes=tuple(notes))


def _usable_frames(
    when: Array, track: Array, joint_time: Array, max_gap: float
) -> tuple[Mask, dict[str, int]]:
    """Frames (n,) with a tag and joints, and how many others there are, by the reason.

    when : (n,) [s], of the joints' clock;  track : (n, 2) [px];  joint_time : (m,) [s]
    Raises LogError if there are none.
    """
    doubts = {
        "a jump of the track": jumps(track),
        **unknown_times(when, joint_time, max_gap),
    }
    usable, dropped = usable_rows(np.isfinite(track[:, 0]), doubts)
    if not usable.any():
        raise LogError(
            f"the clocks are apart: the video runs from {when[0]:.2f} to {when[-1]:.2f} s of the "
            f"joints' clock, which has {joint_time[0]:.2f} to {joint_time[-1]:.2f} s"
        )
    return usable, dropped


def _rests(when: Array, track: Array, slow: Mask) -> list[Index]:
    """The frames of each rest: joints and tag do not move for a few frames.

    when : (n,) [s];  track : (n, 2), the tag [px];  slow : (n,), frames in which no joint moves
    """
    frames = np.flatnonzero(slow)
    steps = row_lengths(np.diff(track[frames], axis=0))
    pauses = np.diff(when[frames])
    is_end = (steps > TAG_REST.shake) | (pauses > TAG_REST.pause)
    rests = []
    for run in np.split(frames, np.flatnonzero(is_end) + 1):
        first = when[run[:1]] + SETTLE
        last = when[run[-1:]] - SETTLE
        settled = run[(when[run] >= first) & (when[run] <= last)]
        if len(settled) >= TAG_REST.least:
            # the arm may still swing while its joints rest: only frames near the median count
            places = track[settled]
            away = places - np.median(places, axis=0)
            rests.append(settled[row_lengths(away) < TAG_REST.shake])
    return [rest for rest in rests if len(rest) >= TAG_REST.least]


def _motion_of(joints: JointTable) -> tuple[Array, Array]:
    """Times (m,) [s] in rising order and the joints (m, dof) at them.

    Of rows at the same time, between which there is no speed, the first one counts.
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


def _video_sightings(video: Video, scene: TagScene) -> tuple[Sightings, Array]:
    """What a video's frames show, and the times (n,) [s] of all n frames."""
    times: list[float] = []

    def frames() -> Iterator[Shot]:
        for number, (stamp, grey) in enumerate(video.frames()):
            times.append(stamp)
            yield number, f"{video.name} at {stamp:.1f} s", grey

    every = 100
    if 0 < video.claimed < 10**7:
        every = max(1, video.claimed // LOOKS)
    sightings = find_sightings(frames(), scene, "frames", every)
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
    if np.linalg.norm(np.ptp(sightings.pixels, axis=0)) < TAG_REST.still:
        u, v = np.median(sightings.pixels, axis=0)
        raise LogError(
            f"tag {sightings.scene.tag} stays at ({u:.0f}, {v:.0f}) px in all of {what} while "
            "the joints move: check that it is on the tip and that no second tag of this id is in "
            "view"
        )


def _log_of(
    sightings: Sightings,
    tags: Sequence[Tag],
    joint_names: tuple[str, ...],
    q: Array,
    about: Document,
    dropped: Mapping[str, int],
) -> Samples:
    """The log of tags at joints (n, dof), with notes of why pictures have none.

    about : how they were recorded
    """
    pixels = np.array([tag.centre for tag in tags])
    readings = _tag_readings(sightings, tags, pixels)
    noise = np.array([tag.noise for tag in tags]) * readings.pixel_size
    dropped = {why: count for why, count in dropped.items() if count}
    source = {
        **about,
        **sightings.document(),
        "noise": math.hypot(rms(noise), readings.shared_sd),
        "noise_of_reference": readings.shared_sd,
        "dropped": dropped,
    }
    return Samples(
        q,
        readings.x,
        joint_names,
        unit=readings.unit,
        pixels=pixels,
        source=source,
        orientation=readings.quaternion,
        notes=left_out_notes(sightings.what, dropped),
    )


def _tag_readings(
    sightings: Sightings, tags: Sequence[Tag], pixels: Array
) -> TagReadings:
    """What tags with their centres at pixels (n, 2) measure.

    These pixels, places on the reference's plane, or where the tag's size is known, poses.
    """
    scene = sightings.scene
    reference, _ = sightings.reference
    readings = TagReadings(pixels, "px", np.ones(1))
    if reference is not None:
        x = reference.positions(pixels)
        pixel_size, sd = reference.noise(pixels)
        readings = TagReadings(x, "m", pixel_size, rms(sd))
    if scene.lens is None or scene.tag_size is None:
        return readings

    # poses by each tag alone, in the reference's frame or the camera's
    frames = _tag_frames(tags, scene.lens, scene.tag_size)
    pixel_size = readings.pixel_size
    if reference is None:
        pixel_size = shift_of(frames)[:, 2] / scene.lens.focal.mean()
    else:
        frames = inverse(reference.pose.frame) @ frames
    return TagReadings(
        shift_of(frames),
        "m",
        pixel_size,
        readings.shared_sd,
        quaternion_of(turn_of(frames)),
    )


def _tag_frames(tags: Sequence[Tag], lens: Lens, side: float) -> Array:
    """Frames (n, 4, 4) [m] of tags of a side [m] before the camera.

    Their origin is in the middle, x to the right, y up, z out of the paper.
    """
    corners = [[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]
    square = 0.5 * side * np.array(corners)
    return frames_of([find_pose(lens, square, tag.corners) for tag in tags])
