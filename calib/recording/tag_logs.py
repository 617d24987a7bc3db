"""Logs from pictures, one posture each, and from videos, where the arm rests or moves slowly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arm.rigid import inverse, shift_of, turn_of
from ..arm.rotations import quaternion_of
from ..common.arrays import Array, Index, Mask
from ..common.atomic import FilePath
from ..common.parallel import one_blas_thread
from ..common.rows import row_lengths
from ..errors import LogError
from ..samples.lens import Lens
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
from .pictures import Shot, Video
from .reference import PlaneReference, find_pose, frames_of
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
    elsewhere = np.isin(sightings.numbers, list(sightings.reference[1]))
    steady = np.flatnonzero(~elsewhere)
    dropped = {
        **sightings.reasons,
        "cut off or damaged": len(rows) - sightings.count,
        "the reference is elsewhere in them: camera bumped, shaken, refocused?": int(
            elsewhere.sum()
        ),
    }
    tags = [sightings.tags[k] for k in steady]
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

    joints : with times, by a clock of their own
    time_offset : [s], added to the video's times; found if not given
    still : [rad/s or m/s], every frame in which no joint moves faster is a row; without it the
        median of each rest is
    max_gap : [s], frames between joints further apart are left out
    Raises LogError in one line, if no log can be made.
    """
    check_limits(max_gap, still)
    film = _film(Video(path), joints, setting, time_offset, max_gap)
    notes = film.notes
    if still is None:
        why = "the arm moves"
        groups = film.rests()
    else:
        why = f"a joint moves faster than {still:g}"
        is_slow = film.usable & (film.speed < still)
        groups = [np.array([frame]) for frame in np.flatnonzero(is_slow)]
    if not groups:
        raise LogError(
            f"the arm never rests for {REST.least} frames of {film.name}, or moves as slowly as "
            "`still`: record it with stops"
        )
    frames = sum(map(len, groups))
    if still is None:
        mean = frames / len(groups)
        notes = (*notes, f"{len(groups)} rests of {mean:.0f} frames")
    moving = int(film.usable.sum()) - frames

    # tag, joints and time of each row
    sightings = film.sightings
    tag_of = dict(zip(sightings.numbers, sightings.tags, strict=True))
    tags = [_median_tag([tag_of[k] for k in group]) for group in groups]
    q = np.array([film.q[group].mean(axis=0) for group in groups])
    time = np.array([np.median(film.when[group]) for group in groups])
    about: dict[str, object] = {
        "source": "video",
        "time_offset": film.clocks.offset,
        "rate": film.clocks.rate,
    }
    dropped = {**film.dropped, why: moving}
    log = _log_of(sightings, tags, joints.names, q, about, dropped)
    return replace(log, time=time - time[0], notes=(*notes, *log.notes))


@dataclass(frozen=True, eq=False)
class Film:
    """The n frames of a video, and the joints at their times."""

    name: str
    sightings: Sightings
    clocks: Clocks
    when: Array  # (n,), by the joints' clock [s]
    track: Array  # (n, 2), the tag [px]; NaN where it is not seen
    q: Array  # (n, dof) [rad or m]
    speed: Array  # (n,), of the fastest joint [rad/s or m/s]
    usable: Mask  # (n,), frames that show the tag and whose joints are known
    dropped: Mapping[str, int]  # how many are not, by reason
    notes: tuple[str, ...]

    def rests(self) -> list[Index]:
        """The frames of each rest: joints and tag stand still for a few frames."""
        when = self.when
        frames = np.flatnonzero(self.usable & (self.speed < REST.rest))
        steps = row_lengths(np.diff(self.track[frames], axis=0))
        is_end = (steps > REST.shake) | (np.diff(when[frames]) > REST.pause)
        rests = []
        for run in np.split(frames, np.flatnonzero(is_end) + 1):
            first = when[run[:1]] + SETTLE
            last = when[run[-1:]] - SETTLE
            settled = run[(when[run] >= first) & (when[run] <= last)]
            if len(settled) >= REST.least:
                # the arm may still swing where its joints stand: only frames near the median count
                places = self.track[settled]
                away = places - np.median(places, axis=0)
                distances = row_lengths(away)
                rests.append(settled[distances < REST.shake])
        return [rest for rest in rests if len(rest) >= REST.least]


def _film(
    video: Video,
    joints: JointTable,
    setting: Setting,
    time_offset: float | None,
    max_gap: float,
) -> Film:
    """The frames of a video; arguments as of `log_video`."""
    joint_time, q = _motion_of(joints)
    sightings, time = _video_sightings(video, setting)
    _check_motion(q, sightings, video.name)
    track = np.full((len(time), 2), np.nan)
    track[sightings.numbers] = sightings.pixels
    notes = video.notes(len(time))
    clocks = Clocks(time_offset or 0.0)
    if time_offset is None:
        clocks = align_clocks(time, track, joint_time, q, joints.revolute)
        notes.append(clocks.words())
    when = clocks.joints_time(time)
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
    return Film(
        video.name,
        sightings,
        clocks,
        when,
        track,
        q=joints_at(when, joint_time, q),
        speed=joint_speed(when, joint_time, q),
        usable=usable,
        dropped={**sightings.reasons, **dropped},
        notes=tuple(notes),
    )


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
    return time, joints.q[first]


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
    variances = np.var([tag.centre for tag in tags], axis=0, ddof=1)
    scatter = float(np.sqrt(np.mean(variances)))
    # a median scatters by 1.25 times what a mean does (normal noise)
    noise = 1.25 * scatter / float(np.sqrt(len(tags)))
    corners = np.median([tag.corners for tag in tags], axis=0)
    return replace(tags[0], corners=corners, noise=max(LEAST_NOISE, noise))


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


@dataclass(frozen=True, eq=False)
class Positions:
    """Where tags are."""

    x: Array  # (n, 2) or (n, 3) [unit]
    unit: str
    scale: Array  # (n,) or (1,), size of a pixel there [unit/px]
    shared_sd: float = 0.0  # of what all rows share [unit]
    quaternion: Array | None = None  # (n, 4)


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
    positions = _positions(tags, sightings)
    noise = np.array([tag.noise for tag in tags]) * positions.scale
    rms = np.sqrt(np.mean(noise**2))
    dropped = {why: count for why, count in dropped.items() if count}
    source = {
        **about,
        **sightings.document(),
        "noise": float(np.hypot(rms, positions.shared_sd)),
        "noise_of_reference": positions.shared_sd,
        "dropped": dropped,
    }
    return Samples(
        q,
        positions.x,
        joint_names,
        unit=positions.unit,
        pixels=np.array([tag.centre for tag in tags]),
        source=source,
        orientation=positions.quaternion,
        notes=left_out_notes(sightings.what, dropped),
    )


def _positions(tags: Sequence[Tag], sightings: Sightings) -> Positions:
    """Where tags are: by their size, in the plane of the reference, or in pixels."""
    setting = sightings.setting
    reference, _ = sightings.reference
    if setting.lens is not None and setting.tag_size is not None:
        return _by_tag_size(tags, setting.lens, setting.tag_size, reference)
    pixels = np.array([tag.centre for tag in tags])
    if reference is not None:
        return _on_plane(reference, pixels)
    return Positions(pixels, "px", np.ones(1))


def _on_plane(reference: PlaneReference, pixels: Array) -> Positions:
    """Positions in the reference's frame of tags at pixels (n, 2) that lie in its plane."""
    scale, sd = reference.noise(pixels)
    shared_sd = float(np.sqrt(np.mean(sd**2)))
    return Positions(reference.positions(pixels), "m", scale, shared_sd)


def _by_tag_size(
    tags: Sequence[Tag],
    lens: Lens,
    side: float,
    reference: PlaneReference | None,
) -> Positions:
    """Positions of tags of a side [m] by each alone, in the reference's frame or the camera's.

    The tag's frame: origin in its middle, x to the right, y up, z out of the paper.
    """
    corners = [[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]
    square = 0.5 * side * np.array(corners)
    frames = frames_of([find_pose(lens, square, tag.corners) for tag in tags])
    if reference is None:
        scale = shift_of(frames)[:, 2] / lens.focal.mean()
        positions = Positions(shift_of(frames), "m", scale)
    else:
        frames = inverse(reference.pose.frame) @ frames
        positions = _on_plane(reference, np.array([tag.centre for tag in tags]))
    return replace(
        positions,
        x=shift_of(frames),
        quaternion=quaternion_of(turn_of(frames)),
    )
