"""Poses in bags: what a tracker or camera published of the tip, as stamped messages or as tf."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
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


@dataclass
class _Edge:
    """The transforms from one frame to its child."""

    parent: str
    time: list[float] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def still(self) -> bool:
        """Whether it is the same in every message."""
        rows = np.array(self.rows)
        # q and -q are one orientation
        rows[rows[:, 3:] @ rows[0, 3:] < 0, 3:] *= -1
        return bool(np.abs(rows - rows[0]).max() < _SAME)


def stamped_poses(messages: Iterable[tuple[float, Any]], kind: str, topic: str) -> Poses:
    """Read stamped points, poses or transforms; orientations that never turn are left out."""
    where, turn = POSITIONS[kind]
    times, places, turns = [], [], []
    for time, message in messages:
        point = attrgetter(where)(message)
        times.append(time)
        places.append((point.x, point.y, point.z))
        if turn is not None:
            q = attrgetter(turn)(message)
            turns.append((q.x, q.y, q.z, q.w))
    if not times:
        raise LogError(f"topic {topic!r} has no messages")
    return Poses(np.array(times), np.array(places, dtype=float), _turning(turns))


def tf_poses(messages: Iterable[tuple[float, Any]], frames: Sequence[str] | None) -> Poses:
    """Read the one moving transform of a tf tree between two frames, still ones around it.

    frames : the sensor's frame and what it sees; found if only one transform moves
    """
    edges: dict[str, _Edge] = {}
    for received, message in messages:
        for each in message.transforms:
            stamp = each.header.stamp
            seconds = stamp.sec + 1e-9 * stamp.nanosec
            edge = edges.setdefault(each.child_frame_id, _Edge(each.header.frame_id))
            if edge.parent == each.header.frame_id:
                x, q = each.transform.translation, each.transform.rotation
                edge.time.append(seconds if seconds > 0 else received)
                edge.rows.append((x.x, x.y, x.z, q.x, q.y, q.z, q.w))
    moving = [child for child, edge in edges.items() if not edge.still]
    shown = listed(f"{edges[child].parent},{child}" for child in sorted(moving)) or "none"
    if frames is None:
        if len(moving) != 1:
            raise LogError(
                f"{len(moving)} transforms of tf move: {shown}",
                hint="name the sensor's frame and the tip's as `frames`",
                parameter="frames",
            )
        frames = edges[moving[0]].parent, moving[0]
    parent, child = frames
    path: list[str] = []
    at = child
    while at != parent:
        if at not in edges or at in path:
            raise LogError(f"tf has no way from {parent!r} to {child!r}; moving: {shown}")
        path.append(at)
        at = edges[at].parent
    measured = [frame for frame in path if frame in moving]
    if len(measured) != 1:
        raise LogError(
            f"{len(measured)} transforms move between {parent!r} and {child!r}, expected the one "
            f"that was measured; moving: {shown}"
        )
    times = np.array(edges[measured[0]].time)
    place, turn = np.zeros((1, 3)), np.eye(3)[None]
    for frame in path:  # from the child up: x_parent = R x + t
        rows = np.array(edges[frame].rows)[: None if frame in measured else 1]
        matrices = matrix_of(rows[:, 3:])
        place = (matrices @ place[:, :, None])[:, :, 0] + rows[:, :3]
        turn = matrices @ turn
    return Poses(times, place, _turning(quaternion_of(turn)))


def _turning(quaternions: Any) -> Array | None:
    """Quaternions (n, 4), None where there are none or a driver left them unset."""
    rows = np.asarray(quaternions, dtype=float).reshape(-1, 4)
    if not len(rows) or np.abs(np.abs(rows @ rows[0]) - 1).max() < _SAME or not rows.any():
        return None
    return rows
