"""Places as files for others: static transforms of ROS, matrices, OpenCV's rvec and tvec."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from ..arm.rotations import logarithm, matrix_of
from .places import HandEye, Place


def transform_files(
    rig: HandEye, base: str, tip: str, path: str | os.PathLike[str]
) -> dict[Path, str]:
    """The text of each file: transforms in JSON, and beside it lines and matrices for people.

    base, tip : names of the arm's frames
    """
    carried, standing = (
        ("camera", "board") if rig.eye == "hand" else ("board", "camera")
    )
    frames = [
        (tip, f"{carried}_frame", rig.hand),
        (base, f"{standing}_frame", rig.base),
    ]
    if len(rig.cameras) > 1:
        frames = [frame for frame in frames if not frame[1].startswith("camera")]
        for camera in rig.cameras:
            parent = tip if camera.eye == "hand" else base
            frames.append((parent, f"{camera.name}_frame", camera.place))
    stamped = [_stamped(*frame) for frame in frames]
    lines = []
    for parent, child, place in frames:
        lines += _words(parent, child, place)
    document = json.dumps(stamped, indent=2) + "\n"
    return {
        Path(path): document,
        Path(path).with_suffix(".txt"): "\n".join(lines) + "\n",
    }


def _stamped(parent: str, child: str, place: Place) -> dict[str, object]:
    """A geometry_msgs/TransformStamped."""
    transform = {
        "translation": dict(zip("xyz", place["position"], strict=True)),
        "rotation": dict(zip("xyzw", place["quaternion"], strict=True)),
    }
    return {
        "header": {"frame_id": parent},
        "child_frame_id": child,
        "transform": transform,
    }


def _words(parent: str, child: str, place: Place) -> list[str]:
    x, y, z = (repr(value) for value in place["position"])
    qx, qy, qz, qw = (repr(value) for value in place["quaternion"])
    turn = matrix_of(np.array(place["quaternion"])[None])
    matrix = np.eye(4)
    matrix[:3, :3] = turn[0]
    matrix[:3, 3] = place["position"]
    rows = [" ".join(f"{cell: .9f}" for cell in row) for row in matrix]
    return [
        f"# {child} in {parent}",
        f"ros2 run tf2_ros static_transform_publisher --x {x} --y {y} --z {z} --qx {qx} --qy {qy} "
        f"--qz {qz} --qw {qw} --frame-id {parent} --child-frame-id {child}",
        *rows,
        f"rvec {logarithm(turn)[0].tolist()}",
        f"tvec {place['position']}",
        "",
    ]
