"""Bags: ROS 1 and ROS 2 recordings and MCAP files, as logs.

Joint states and tip positions are messages of their own, at rates of their own: the joints
are interpolated to the times of the positions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from ..arm.rotations import matrix_of, quaternion_of
from ..common.arrays import Array
from ..common.wording import INSTALL, listed
from ..errors import LogError
from ..samples.joint_values import MAX_GAP, check_limits, covered, joint_speed, joints_at
from ..samples.recorded import Recorded, told
from .clocks import SURE, ClockError, align_clocks

_JOINT_STATE = "sensor_msgs/msg/JointState"
#: Types of messages with a position, where it stands, and where the orientation does.
_POSITIONS = {
    "geometry_msgs/msg/PointStamped": ("point", None),
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform.translation", "transform.rotation"),
}
_TF = "tf2_msgs/msg/TFMessage"
#: Turns [rad] and lengths [m] below which a transform is the same.
_SAME = 1e-9
#: Offsets [s] below which stamps are taken as they are: training estimates what is left.
_IN_TIME = 0.005
_INSTALL = f"reading bags needs rosbags: {INSTALL.format('ros')}"


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
) -> Recorded:
    """Read joint states and positions, or poses, of the tip from a recording.

    path : a ROS 1 ``.bag``, a ROS 2 bag (its folder), or an ``.mcap`` or ``.db3`` file
    joints_topic, tip_topic : topics; found where only one has a fitting type
    joints : joints to keep; all where not given
    max_gap : [s], positions between joint states further apart are left out
    still : [rad/s or m/s], positions taken while a joint moved faster are left out
    time_offset : [s], added to the times of the positions: the sensor's clock or latency; found
        where not given, and left at 0 where the stamps fit
    frames : of tf: the sensor's frame and the tip's, or what is fixed to it
    Raises LogError if rosbags is missing, the file is no recording, or a topic is not in it.
    """
    check_limits(max_gap, still)
    with _reader(Path(path)) as reader:
        topics = {c.topic: c.msgtype for c in reader.connections}
        source = _topic(topics, joints_topic, (_JOINT_STATE,), "joints_topic", "JointState")
        names, times, values = _joint_states(reader, source, joints)
        poses, frame = _poses(reader, topics, tip_topic, frames)
    made = _aligned(names, times, values, poses, time_offset, max_gap, still)
    return replace(made, source={"source": "bag", "frame": frame} if frame else {"source": "bag"})


def _poses(
    reader: Any, topics: Mapping[str, str], chosen: str | None, frames: Sequence[str] | None
) -> tuple[Array, str]:
    """The tip's poses and their frame; of tf where frames are named or nothing else is there."""
    tf = sorted(topic for topic, kind in topics.items() if kind == _TF)
    others = [topic for topic, kind in topics.items() if kind in _POSITIONS]
    if tf and (frames is not None or chosen in tf or (chosen is None and not others)):
        return _tf_poses((m for topic in tf for m in _messages(reader, topic)), frames)
    if frames is not None:
        raise LogError("`frames` names frames of tf, and the recording has no tf")
    kinds = "PointStamped, PoseStamped, TransformStamped or TFMessage"
    target = _topic(topics, chosen, tuple(_POSITIONS), "tip_topic", kinds)
    messages = list(_messages(reader, target))
    if not messages:
        raise LogError(f"topic {target!r} has no messages")
    where, turn = _POSITIONS[topics[target]]
    place, quaternion = attrgetter(where), attrgetter(turn) if turn else lambda _: None
    rows = [_row(time, place(message), quaternion(message)) for time, message in messages]
    return np.array(rows), str(messages[0][1].header.frame_id)


@contextmanager
def _reader(path: Path) -> Iterator[Any]:
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError(_INSTALL) from None
    if not path.exists():
        raise LogError(f"there is no file {str(path)!r}")
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        raise LogError(
            f"{path} is no recording that can be read ({error or type(error).__name__}): expected "
            "a ROS 1 .bag, the folder of a ROS 2 bag, or an .mcap file"
        ) from None
    try:
        yield reader
    finally:
        reader.close()


def _topic(
    topics: Mapping[str, str], chosen: str | None, types: Sequence[str], parameter: str, kind: str
) -> str:
    fitting = sorted(name for name, kind in topics.items() if kind in types)
    shown = listed(f"{name} ({kind.rpartition('/')[2]})" for name, kind in sorted(topics.items()))
    if chosen is None:
        if len(fitting) == 1:
            return fitting[0]
        many = f"{len(fitting)} topics of type {kind}" if fitting else f"no topic of type {kind}"
        raise LogError(
            f"the recording has {many}; its topics: {shown}",
            hint=f"name one as `{parameter}`",
            parameter=parameter,
        )
    if chosen not in fitting:
        is_one = f"is a {topics[chosen].rpartition('/')[2]}" if chosen in topics else "is not there"
        raise LogError(
            f"topic {chosen!r} {is_one}, expected {kind}; the recording's topics: {shown}"
        )
    return chosen


def _messages(reader: Any, topic: str) -> Iterator[tuple[float, Any]]:
    """Time of each message [s], its own stamp where it has one, and the message."""
    connections = [c for c in reader.connections if c.topic == topic]
    for connection, recorded, raw in reader.messages(connections=connections):
        message = reader.deserialize(raw, connection.msgtype)
        header = getattr(message, "header", None)
        seconds = 0.0 if header is None else header.stamp.sec + 1e-9 * header.stamp.nanosec
        yield (seconds if seconds > 0 else 1e-9 * recorded), message


def _joint_states(
    reader: Any, topic: str, joints: Sequence[str] | None
) -> tuple[tuple[str, ...], Array, Array]:
    names: tuple[str, ...] = tuple(joints or ())
    times: list[float] = []
    rows: list[list[float]] = []
    seen: set[str] = set()
    for time, message in _messages(reader, topic):
        there = dict(zip(message.name, np.asarray(message.position).tolist(), strict=False))
        seen |= set(message.name)
        names = names or tuple(message.name)
        # messages of another controller on the same topic
        if all(name in there for name in names):
            times.append(time)
            rows.append([there[name] for name in names])
    if not rows:
        missing = [name for name in names if name not in seen]
        what = f"no joint {missing[0]!r}" if missing else "no joint states"
        raise LogError(f"topic {topic!r} has {what}; its joints: {listed(sorted(seen))}")
    return names, np.array(times), np.array(rows, dtype=float)


def _aligned(
    names: tuple[str, ...],
    times: Array,
    values: Array,
    poses: Array,
    time_offset: float | None,
    max_gap: float,
    still: float | None,
) -> Recorded:
    """Interpolate the joints to the times of the positions and leave out what is doubtful."""
    good = np.isfinite(values).all(axis=1)
    times, first = np.unique(times[good], return_index=True)  # in order, each time once
    values = values[good][first]
    if len(times) < 2:
        raise LogError("the recording has fewer than two joint states: nothing to interpolate")
    poses = poses[np.argsort(poses[:, 0], kind="stable")]
    stamps, x = poses[:, 0], poses[:, 1:4]
    said: list[str] = []
    if time_offset is None:
        time_offset, said = _found_offset(stamps, x, times, values)
    stamps = stamps + time_offset
    turns = poses[:, 4:] if _turn(poses[:, 4:]) else None  # drivers may leave them unset
    doubts = covered(stamps, times, max_gap) | {"not finite": ~np.isfinite(x).all(axis=1)}
    if still is not None:
        fast = joint_speed(stamps, times, values) > still
        doubts[f"a joint moved faster than {still:g}"] = fast & ~np.any([*doubts.values()], axis=0)
    usable = ~np.any([*doubts.values()], axis=0)
    dropped = {why: int(rows.sum()) for why, rows in doubts.items() if rows.any()}
    notes = [*said, *told(dropped, "positions")]
    if not usable.any():
        raise LogError(
            f"no position is left ({'; '.join(notes)})",
            hint="change `max_gap`, `still` or `time_offset`",
            parameter="max_gap",
            value=max_gap,
        )
    stamps = stamps[usable]
    return Recorded(
        names,
        joints_at(stamps, times, values),
        x[usable],
        quaternion=None if turns is None else turns[usable],
        time=stamps - stamps[0],
        dropped=dropped,
        notes=tuple(notes),
    )


def _found_offset(stamps: Array, x: Array, times: Array, values: Array) -> tuple[float, list[str]]:
    """What has to be added to the stamps of positions [s], and what the user should be told.

    Raises LogError if the two clocks have no time in common and no offset is sure.
    """
    apart = float(times[0] - stamps[0])
    common = min(times[-1], stamps[-1]) - max(times[0], stamps[0])
    seen = np.asarray(np.isfinite(x).all(axis=1))
    try:
        clocks = align_clocks(stamps - stamps[0], np.where(seen[:, None], x, np.nan),
                              times - times[0], values, unit="m")  # fmt: skip
    except ClockError as error:
        if common > 0:
            return 0.0, []  # the stamps are all that is known
        raise LogError(
            f"the clocks of joints and positions are {abs(apart):.10g} s apart: the joints start "
            f"at {times[0]:.10g} s, the positions at {stamps[0]:.10g} s, and {error}",
            hint="give their difference as `time_offset`",
            parameter="time_offset",
        ) from None
    offset = clocks.offset + apart
    if common > 0 and abs(offset) < max(_IN_TIME, 3.0 * clocks.doubt):
        return 0.0, []
    interval = f"{offset:+.4f} +- {2.0 * max(clocks.doubt, SURE):.2g} s"
    return offset, [f"the positions' clock is corrected by {interval}, as the motion shows"]


def _row(time: float, place: Any, turn: Any) -> tuple[float, ...]:
    """Time [s], position [m] and quaternion, 0 where there is none."""
    quaternion = (turn.x, turn.y, turn.z, turn.w) if turn is not None else (0.0, 0.0, 0.0, 0.0)
    return time, place.x, place.y, place.z, *quaternion


def _tf_poses(
    messages: Iterable[tuple[float, Any]], frames: Sequence[str] | None
) -> tuple[Array, str]:
    """Read the one moving transform of a tf tree between two frames, still ones around it.

    frames : the sensor's frame and what it sees; found if only one transform moves
    """
    parents: dict[str, str] = {}
    moves: dict[str, list[tuple[float, ...]]] = {}  # rows by child
    for received, message in messages:
        for each in message.transforms:
            child, stamp = each.child_frame_id, each.header.stamp
            seconds = stamp.sec + 1e-9 * stamp.nanosec
            if parents.setdefault(child, each.header.frame_id) == each.header.frame_id:
                time = seconds if seconds > 0 else received
                row = _row(time, each.transform.translation, each.transform.rotation)
                moves.setdefault(child, []).append(row)
    edges = {child: np.array(rows) for child, rows in moves.items()}
    moving = [
        child
        for child, rows in edges.items()
        if np.ptp(rows[:, 1:4], axis=0).max() >= _SAME or _turn(rows[:, 4:])
    ]
    shown = listed(f"{parents[child]},{child}" for child in sorted(moving)) or "none"
    if frames is None:
        if len(moving) != 1:
            raise LogError(
                f"{len(moving)} transforms of tf move: {shown}",
                hint="name the sensor's frame and the tip's as `frames`",
                parameter="frames",
            )
        frames = parents[moving[0]], moving[0]
    parent, child = frames
    path: list[str] = []
    at = child
    while at != parent:
        if at not in edges or at in path:
            raise LogError(f"tf has no way from {parent!r} to {child!r}; moving: {shown}")
        path.append(at)
        at = parents[at]
    measured = [frame for frame in path if frame in moving]
    if len(measured) != 1:
        raise LogError(
            f"{len(measured)} transforms move between {parent!r} and {child!r}, expected the one "
            f"that was measured; moving: {shown}"
        )
    place, turn = np.zeros((1, 3)), np.eye(3)[None]
    for frame in path:  # from the child up: x_parent = R x + t
        rows = edges[frame][: None if frame in measured else 1]
        matrices = matrix_of(rows[:, 4:])
        place = (matrices @ place[:, :, None])[:, :, 0] + rows[:, 1:4]
        turn = matrices @ turn
    return np.hstack([edges[measured[0]][:, :1], place, quaternion_of(turn)]), parent


def _turn(rows: Array) -> bool:
    """Whether quaternions (n, 4) differ from each other; q and -q are one orientation."""
    return bool(rows.any() and np.abs(np.abs(rows @ rows[0]) - 1).max() >= _SAME)
