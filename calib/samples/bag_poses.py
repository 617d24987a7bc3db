"""Poses in bags: what a tracker or camera published of the tip, as stamped messages or as tf."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from ..arm.rotations import matrix_of, quaternion_of
from ..common.arrays import Array
from ..common.wording import listed
from ..errors import LogError

#: Types of messages with a position, where it stands, and where the orientation does.
POSITIONS = {
    "geometry_msgs/msg/PointStamped": ("point", None),
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform.translation", "transform.rotation"),
}
TF = "tf2_msgs/msg/TFMessage"
#: Turns [rad] and lengths [m] below which a transform is the same.
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Poses:
    """What was published of the tip: times (n,) [s], positions (n, 3) [m], quaternions (n, 4)."""

    time: Array
    x: Array
    quaternion: Array | None


def stamped_poses(messages: Iterable[tuple[float, Any]], kind: str, topic: str) -> Poses:
    """Read stamped points, poses or transforms; orientations that never turn are left out."""
    where, turn = POSITIONS[kind]
    rows = [(time, attrgetter(where)(m), turn and attrgetter(turn)(m)) for time, m in messages]
    if not rows:
        raise LogError(f"topic {topic!r} has no messages")
    times = np.array([time for time, *_ in rows])
    places = np.array([(p.x, p.y, p.z) for _, p, _ in rows], dtype=float)
    return Poses(times, places, _turning([(q.x, q.y, q.z, q.w) for *_, q in rows if q]))


def tf_poses(messages: Iterable[tuple[float, Any]], frames: Sequence[str] | None) -> Poses:
    """Read the one moving transform of a tf tree between two frames, still ones around it.

    frames : the sensor's frame and what it sees; found if only one transform moves
    """
    parents: dict[str, str] = {}
    moves: dict[str, list[tuple[float, ...]]] = {}  # by child: time, translation, quaternion
    for received, message in messages:
        for each in message.transforms:
            child, stamp = each.child_frame_id, each.header.stamp
            seconds = stamp.sec + 1e-9 * stamp.nanosec
            if parents.setdefault(child, each.header.frame_id) == each.header.frame_id:
                x, q = each.transform.translation, each.transform.rotation
                time = seconds if seconds > 0 else received
                moves.setdefault(child, []).append((time, x.x, x.y, x.z, q.x, q.y, q.z, q.w))
    edges = {child: np.array(rows) for child, rows in moves.items()}
    moving = [child for child, rows in edges.items() if _moves(rows[:, 1:])]
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
    return Poses(edges[measured[0]][:, 0], place, _turning(quaternion_of(turn)))


def _moves(rows: Array) -> bool:
    """Whether transforms (n, 7), translations and quaternions, differ from each other."""
    # q and -q are one orientation
    sign = np.where(rows[:, 3:] @ rows[0, 3:] < 0, -1.0, 1.0)[:, None]
    same = np.hstack([rows[:, :3], sign * rows[:, 3:]])
    return bool(np.abs(same - rows[0]).max() >= _SAME)


def _turning(quaternions: Any) -> Array | None:
    """Quaternions (n, 4), None where there are none or a driver left them unset."""
    rows = np.asarray(quaternions, dtype=float).reshape(-1, 4)
    if not len(rows) or np.abs(np.abs(rows @ rows[0]) - 1).max() < _SAME or not rows.any():
        return None
    return rows
