"""Bags: ROS 1 and ROS 2 recordings and MCAP files, as logs.

Joint states and tip positions are messages of their own, at rates of their own: the joints
are interpolated to the times of the positions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
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

_JOINTS = ("sensor_msgs/msg/JointState",)
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
        source = _topic(topics, joints_topic, _JOINTS, "joints_topic", "JointState")
        names, times, values = _joint_states(reader, source, joints)
        poses, frame = _poses(reader, topics, tip_topic, frames)
    poses = poses[np.argsort(poses[:, 0], kind="stable")]
    stamps, x = poses[:, 0], poses[:, 1:4]
    offset, notes = time_offset or 0.0, list[str]()
    if time_offset is None:
        offset, notes = _found_offset(stamps, x, times, values)
    stamps = stamps + offset
    doubts = covered(stamps, times, max_gap) | {"not finite": ~np.isfinite(x).all(axis=1)}
    if still is not None:
        fast = joint_speed(stamps, times, values) > still
        doubts[f"a joint moved faster than {still:g}"] = fast & ~np.any([*doubts.values()], axis=0)
    usable = np.asarray(~np.any([*doubts.values()], axis=0))
    dropped = {why: int(rows.sum()) for why, rows in doubts.items() if rows.any()}
    notes += told(dropped, "positions")
    if not usable.any():
        hint = "change `max_gap`, `still` or `time_offset`"
        raise LogError(f"no position is left ({'; '.join(notes)})", hint=hint)
    stamps = stamps[usable]
    turned = _turns(poses[:, 4:])  # drivers may leave orientations unset
    return Recorded(
        names,
        joints_at(stamps, times, values),
        x[usable],
        source={"source": "bag", **({"frame": frame} if frame else {})},
        quaternion=poses[usable, 4:] if turned else None,
        time=stamps - stamps[0],
        dropped=dropped,
        notes=tuple(notes),
    )


@contextmanager
def _reader(path: Path) -> Iterator[Any]:
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError(f"reading bags needs rosbags: {INSTALL.format('ros')}") from None
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
    """The topic that was chosen, or the only one of some types."""
    fitting = sorted(name for name, each in topics.items() if each in types)
    if chosen in fitting or (chosen is None and len(fitting) == 1):
        return chosen or fitting[0]
    shown = listed(f"{name} ({each.rpartition('/')[2]})" for name, each in sorted(topics.items()))
    what = f"{len(fitting)} topics are a {kind}"
    if chosen is not None:
        is_one = f"is a {topics[chosen].rpartition('/')[2]}" if chosen in topics else "is not there"
        what = f"topic {chosen!r} {is_one}, expected {kind}"
    hint = f"name one as `{parameter}`"
    raise LogError(f"{what}; the recording's topics: {shown}", hint=hint)


def _messages(reader: Any, topics: Sequence[str]) -> Iterator[tuple[float, Any]]:
    """Time of each message [s], its own stamp where it has one, and the message."""
    connections = [c for c in reader.connections if c.topic in topics]
    for connection, recorded, raw in reader.messages(connections=connections):
        message = reader.deserialize(raw, connection.msgtype)
        yield _seconds(message, 1e-9 * recorded), message


def _seconds(message: Any, received: float) -> float:
    header = getattr(message, "header", None)
    seconds = 0.0 if header is None else header.stamp.sec + 1e-9 * header.stamp.nanosec
    return seconds if seconds > 0 else received


def _joint_states(
    reader: Any, topic: str, joints: Sequence[str] | None
) -> tuple[tuple[str, ...], Array, Array]:
    """Names of the joints, and their values (n, joints) at increasing times (n,)."""
    names: tuple[str, ...] = tuple(joints or ())
    rows: dict[float, list[float]] = {}
    seen: set[str] = set()
    for time, message in _messages(reader, [topic]):
        there = dict(zip(message.name, np.asarray(message.position).tolist(), strict=False))
        seen |= set(message.name)
        names = names or tuple(message.name)
        # others are messages of another controller on the same topic
        if all(np.isfinite(there.get(name, np.nan)) for name in names):
            rows.setdefault(time, [there[name] for name in names])
    if len(rows) < 2:
        missing = [name for name in names if name not in seen]
        what = f"no joint {missing[0]!r}" if missing else f"{len(rows)} joint states, 2 expected"
        raise LogError(f"topic {topic!r} has {what}; its joints: {listed(sorted(seen))}")
    times = np.array(sorted(rows))
    return names, times, np.array([rows[time] for time in times.tolist()])


def _found_offset(stamps: Array, x: Array, times: Array, values: Array) -> tuple[float, list[str]]:
    """What has to be added to the stamps of positions [s], and what the user should be told."""
    apart = float(times[0] - stamps[0])
    common = min(times[-1], stamps[-1]) - max(times[0], stamps[0])
    seen = np.where(np.isfinite(x).all(axis=1, keepdims=True), x, np.nan)
    try:
        clocks = align_clocks(stamps - stamps[0], seen, times - times[0], values, unit="m")
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


def _poses(
    reader: Any, topics: Mapping[str, str], chosen: str | None, frames: Sequence[str] | None
) -> tuple[Array, str]:
    """The tip's times, places and quaternions (n, 8), 0 where there is none, and their frame."""
    tf = sorted(topic for topic, kind in topics.items() if kind == _TF)
    others = [topic for topic, kind in topics.items() if kind in _POSITIONS]
    if tf and (frames is not None or chosen in tf or (chosen is None and not others)):
        return _tf_poses(reader, tf, frames)
    if frames is not None:
        raise LogError("`frames` names frames of tf, and the recording has no tf")
    kinds = "PointStamped, PoseStamped, TransformStamped or TFMessage"
    target = _topic(topics, chosen, tuple(_POSITIONS), "tip_topic", kinds)
    where, turn = _POSITIONS[topics[target]]
    rows, frame = list[tuple[float, ...]](), ""
    for time, message in _messages(reader, [target]):
        turned = attrgetter(turn)(message) if turn else None
        rows.append(_row(time, attrgetter(where)(message), turned))
        frame = frame or str(message.header.frame_id)
    if not rows:
        raise LogError(f"topic {target!r} has no messages")
    return np.array(rows), frame


def _row(time: float, place: Any, turn: Any) -> tuple[float, ...]:
    quaternion = (turn.x, turn.y, turn.z, turn.w) if turn is not None else (0.0, 0.0, 0.0, 0.0)
    return time, place.x, place.y, place.z, *quaternion


def _tf_poses(
    reader: Any, topics: Sequence[str], frames: Sequence[str] | None
) -> tuple[Array, str]:
    """The one moving transform of a tf tree between two frames, with the still ones around it."""
    parents: dict[str, str] = {}
    moves: dict[str, list[tuple[float, ...]]] = {}  # rows by child
    for received, message in _messages(reader, topics):
        for each in message.transforms:
            child = each.child_frame_id
            if parents.setdefault(child, each.header.frame_id) == each.header.frame_id:
                moved, time = each.transform, _seconds(each, received)
                moves.setdefault(child, []).append(_row(time, moved.translation, moved.rotation))
    edges = {child: np.array(rows) for child, rows in moves.items()}
    moving = [
        child
        for child, rows in edges.items()
        if np.ptp(rows[:, 1:4], axis=0).max() >= _SAME or _turns(rows[:, 4:])
    ]
    shown = listed(f"{parents[child]},{child}" for child in sorted(moving)) or "none"
    if frames is None:
        if len(moving) != 1:
            hint = "name the sensor's frame and the tip's as `frames`"
            raise LogError(f"{len(moving)} transforms of tf move: {shown}", hint=hint)
        frames = parents[moving[0]], moving[0]
    parent, child = frames
    path, at = list[str](), child
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


def _turns(rows: Array) -> bool:
    """Whether quaternions (n, 4) differ from each other; q and -q are one orientation."""
    return bool(rows.any() and np.abs(np.abs(rows @ rows[0]) - 1).max() >= _SAME)
