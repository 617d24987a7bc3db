"""Bags: ROS 1 and ROS 2 recordings and MCAP files, as logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.rows import finite_rows
from ..common.wording import INSTALL, listing
from ..errors import LogError
from ..samples.motion import (
    MAX_GAP,
    check_limits,
    joint_speed,
    joints_at,
    rows_of_motion,
    unknown_times,
)
from ..samples.samples import Samples
from .clocks import SURE, ClockError, align_clocks
from .track import left_out_notes, usable_rows

_JOINTS = ("sensor_msgs/msg/JointState",)
_POSITIONS = tuple(
    f"geometry_msgs/msg/{kind}"
    for kind in ("PointStamped", "PoseStamped", "TransformStamped")
)
_TF = "tf2_msgs/msg/TFMessage"
_SAME = 1e-9  # turns [rad] and lengths [m] below which a transform is the same
UNSURE = "stamps are taken as they are: the motion does not show whether the clocks agree"

# [s], offsets below which stamps stay as they are, since training estimates the rest
_IN_TIME = 0.005


def read_bag(
    path: str | Path,
    joints_topic: str | None = None,
    tip_topic: str | None = None,
    *,
    joints: Sequence[str] | None = None,
    max_gap: float = MAX_GAP,
    still: float | None = None,
    time_offset: float | None = None,
    frames: Sequence[str] | None = None,
) -> Samples:
    """Read joint states and positions, or poses, of the tip from a recording.

    path : a ROS 1 ``.bag``, a ROS 2 bag (its folder), or an ``.mcap`` or ``.db3`` file
    joints_topic, tip_topic : topics; found where only one has a fitting type
    joints : joints to keep; all where not given
    max_gap : [s], positions between joint states further apart are left out
    still : [rad/s or m/s], positions taken while a joint moved faster are left out
    time_offset : [s], added to the times of the positions: the sensor's clock or latency; found
        where not given, and left at 0 where the stamps fit
    frames : of tf: the sensor's frame and the tip's, its child
    Raises LogError if rosbags is missing, the file is no recording, or a topic is not in it.
    """
    check_limits(max_gap, still)
    with closing(_reader(Path(path))) as reader:
        topics = {c.topic: c.msgtype for c in reader.connections}
        source = _topic(topics, joints_topic, _JOINTS, "joints_topic")
        names, times, values = _joint_states(reader, source, joints)
        tips = _tip_topics(topics, tip_topic, frames)
        frame, poses = _poses(reader, tips, frames)
    stamps = poses[:, 0]
    x = poses[:, 1:4]
    notes: list[str] = []
    if time_offset is None:
        time_offset, notes = _offset(stamps, x, times, values)
    stamps = stamps + time_offset
    doubts = unknown_times(stamps, times, max_gap)
    doubts["not finite"] = ~finite_rows(x)
    if still is not None:
        fast = joint_speed(stamps, times, values) > still
        doubts[f"a joint moved faster than {still:g}"] = fast
    usable, dropped = usable_rows(np.ones(len(x), bool), doubts)
    notes += left_out_notes("positions", dropped)
    if not usable.any():
        hint = "change `max_gap`, `still` or `time_offset`"
        raise LogError(f"no position is left ({'; '.join(notes)})", hint=hint)
    stamps = stamps[usable]
    # drivers may leave orientations unset
    orientation = poses[usable, 4:] if _turns(poses[:, 4:]) else None
    return Samples(
        joints_at(stamps, times, values),
        x[usable],
        names,
        source={"source": "bag", "frame": frame or None},
        orientation=orientation,
        time=stamps - stamps[0],
        notes=tuple(notes),
    )


def _tip_topics(
    topics: Mapping[str, str],
    tip_topic: str | None,
    frames: Sequence[str] | None,
) -> list[str]:
    """Topics with the tip's place: those of tf if there is no other or if they are chosen."""
    tips = sorted(topic for topic, kind in topics.items() if kind == _TF)
    is_other = tip_topic is not None or {*_POSITIONS} & {*topics.values()}
    if not tips or (frames is None and tip_topic not in tips and is_other):
        return [_topic(topics, tip_topic, (*_POSITIONS, _TF), "tip_topic")]
    return tips


def _reader(path: Path) -> Any:
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError(
            f"reading bags needs rosbags: {INSTALL.format('ros')}"
        ) from None
    if not path.exists():
        raise LogError(f"{path}: no such file or folder, expected a recording")
    try:
        reader = AnyReader(
            [path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)
        )
        reader.open()
    except (
        AnyReaderError,
        OSError,
        ValueError,
        KeyError,
        AssertionError,
    ) as error:
        raise LogError(
            f"{path} is no recording that can be read ({error or type(error).__name__}): expected "
            "a ROS 1 .bag, the folder of a ROS 2 bag, or an .mcap file"
        ) from None
    return reader


def _topic(
    topics: Mapping[str, str],
    chosen: str | None,
    types: Sequence[str],
    parameter: str,
) -> str:
    """The chosen topic, or the only one of some types."""
    fitting = [
        name
        for name, kind in topics.items()
        if kind in types and chosen in (None, name)
    ]
    if len(fitting) == 1:
        return fitting[0]
    shown = listing(
        f"{name} ({kind.rpartition('/')[2]})"
        for name, kind in sorted(topics.items())
    )
    kinds = ", ".join(kind.rpartition("/")[2] for kind in types)
    raise LogError(
        f"{len(fitting)} topics{f' {chosen!r}' if chosen else ''} are of {kinds}, expected one; "
        f"the recording's topics: {shown}",
        hint=f"name one as `{parameter}`",
    )


def _messages(
    reader: Any, topics: Sequence[str]
) -> Iterator[tuple[str, float, Any]]:
    """Topic, time [s] and message of some topics; the message's own stamp where it has one."""
    connections = [c for c in reader.connections if c.topic in topics]
    for connection, received, raw in reader.messages(connections=connections):
        message = reader.deserialize(raw, connection.msgtype)
        yield connection.topic, _seconds(message, 1e-9 * received), message


def _seconds(message: Any, received: float) -> float:
    if not hasattr(message, "header"):
        return received
    stamp = message.header.stamp
    return float(stamp.sec + 1e-9 * stamp.nanosec) or received


def _joint_states(
    reader: Any, topic: str, joints: Sequence[str] | None
) -> tuple[tuple[str, ...], Array, Array]:
    """Names of the joints, and their values (n, joints) at increasing times (n,)."""
    names: tuple[str, ...] = tuple(joints or ())
    rows: dict[float, list[float]] = {}
    recorded: set[str] = set()
    for _, time, message in _messages(reader, [topic]):
        state = dict(zip(message.name, message.position, strict=False))
        recorded |= {*state}
        names = names or tuple(message.name)
        row = [float(state.get(name, np.nan)) for name in names]
        # incomplete messages are of another controller on the same topic
        if np.isfinite(row).all():
            rows.setdefault(time, row)
    if len(rows) < 2:
        raise LogError(
            f"topic {topic!r} has {len(rows)} joint states of {listing(names)}, 2 expected; its "
            f"joints: {listing(sorted(recorded))}"
        )
    times = np.array(sorted(rows))
    values = np.array([rows[time] for time in times.tolist()])
    moving = rows_of_motion(times, values)
    return names, times[moving], values[moving]


def _offset(
    stamps: Array, x: Array, times: Array, values: Array
) -> tuple[float, list[str]]:
    """The correction of the positions' stamps [s], and notes for the user."""
    gap = float(times[0] - stamps[0])
    is_common = min(times[-1], stamps[-1]) > max(times[0], stamps[0])
    track = np.where(finite_rows(x)[:, None], 1e3 * x, np.nan)
    try:
        clocks = align_clocks(
            stamps - stamps[0], track, times - times[0], values, unit="mm"
        )
    except ClockError as error:
        if is_common:
            return 0.0, [UNSURE]
        raise LogError(
            f"the clocks of joints and positions are {abs(gap):.10g} s apart: the joints start "
            f"at {times[0]:.10g} s, the positions at {stamps[0]:.10g} s, and {error}",
            parameter="time_offset",
        ) from None
    offset = clocks.offset + gap
    if is_common and abs(offset) < max(_IN_TIME, 3.0 * clocks.sd):
        return 0.0, []
    interval = f"{offset:+.4f} +- {2.0 * max(clocks.sd, SURE):.2g} s"
    return offset, [
        f"the positions' clock is corrected by {interval}, as the motion shows"
    ]


def _poses(
    reader: Any, topics: Sequence[str], frames: Sequence[str] | None
) -> tuple[str, Array]:
    """The only moving transform or topic: frame, and times, places and quaternions (n, 8) in it.

    Rows are in the order of time.
    frames : parent and child of a transform of tf
    """
    moves: dict[tuple[str, str], list[list[float]]] = {}
    for topic, received, message in _messages(reader, topics):
        for stamped in getattr(message, "transforms", [message]):
            child = getattr(stamped, "child_frame_id", topic)
            pair = (stamped.header.frame_id, child)
            moves.setdefault(pair, []).append(_row(stamped, received))
    moving: dict[tuple[str, str], Array] = {}
    for pair, numbers in moves.items():
        rows = np.array(numbers)
        places = rows[:, 1:4]
        away = places - np.fmin.reduce(places)
        if (away >= _SAME).any() or _turns(rows[:, 4:]):
            moving[pair] = rows
    pairs = [*moving] if frames is None else [(frames[0], frames[1])]
    if len(pairs) != 1 or pairs[0] not in moving:
        shown = listing(",".join(pair) for pair in sorted(moving))
        raise LogError(
            f"{len(moving)} transforms or topics move, expected one: {shown}",
            hint="name one, the sensor's frame and the tip's, as `frames`",
        )
    rows = moving[pairs[0]]
    return pairs[0][0], rows[np.argsort(rows[:, 0], kind="stable")]


def _row(stamped: Any, received: float) -> list[float]:
    """Time, place and quaternion of a message of a position, a pose or a transform."""
    quaternion = [0.0, 0.0, 0.0, 1.0]
    if hasattr(stamped, "point"):
        place = stamped.point
    else:
        place = getattr(stamped, "pose", None) or stamped.transform
        turn = getattr(place, "orientation", None) or place.rotation
        quaternion = [turn.x, turn.y, turn.z, turn.w]
        place = getattr(place, "position", None) or place.translation
    time = _seconds(stamped, received)
    return [time, place.x, place.y, place.z, *quaternion]


def _turns(rows: Array) -> bool:
    """Whether quaternions (n, 4) differ from each other; q and -q are one orientation."""
    if not rows.any():
        return False
    cosines = np.abs(rows @ rows[0])  # of half the angles from the first
    return bool(np.abs(cosines - 1).max() >= _SAME)
