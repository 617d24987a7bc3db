"""Places as files for others: static transforms of ROS, matrices, OpenCV's rvec and tvec."""

from __future__ import annotations

import json
import os
from pathlib import Path

from ..arm.rotations import logarithm, matrix_of
from .rig import HandEye, Place
from .rigid import rigid


def transform_files(
    rig: HandEye, path: str | os.PathLike[str]
) -> dict[Path, str]:
    """The text of each file: transforms in JSON, and beside it lines and matrices for people."""
    base, tip = rig.frames
    places = {f"{rig.carried}_frame": (tip, rig.hand)}
    places[f"{rig.standing}_frame"] = (base, rig.base)
    if len(rig.cameras) > 1:
        del places["camera_frame"]
        for camera in rig.cameras:
            eye = camera["eye"]
            parent = tip if eye == "hand" else base
            places[f"{camera['name']}_frame"] = (parent, camera[eye])
    # geometry_msgs/TransformStamped
    stamped = []
    lines: list[str] = []
    for child, (parent, place) in places.items():
        transform = {
            "translation": dict(zip("xyz", place["position"], strict=True)),
            "rotation": dict(zip("xyzw", place["quaternion"], strict=True)),
        }
        stamped.append(
            {
                "header": {"frame_id": parent},
                "child_frame_id": child,
                "transform": transform,
            }
        )
        lines += _lines(parent, child, place)
    return {
        Path(path): json.dumps(stamped, indent=2) + "\n",
        Path(path).with_suffix(".txt"): "\n".join(lines) + "\n",
    }


def _lines(parent: str, child: str, place: Place) -> list[str]:
    turn = matrix_of(place["quaternion"])
    numbers = zip(
        ("x", "y", "z", "qx", "qy", "qz", "qw"),
        place["position"] + place["quaternion"],
        strict=True,
    )
    options = " ".join(f"--{name} {value!r}" for name, value in numbers)
    rows = rigid(turn, place["position"])
    return [
        f"# {child} in {parent}",
        f"ros2 run tf2_ros static_transform_publisher {options} --frame-id {parent} "
        f"--child-frame-id {child}",
        *(" ".join(f"{cell: .9f}" for cell in row) for row in rows),
        f"rvec {logarithm(turn).tolist()}",
        f"tvec {place['position']}",
        "",
    ]
