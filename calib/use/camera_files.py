"""Camera files: a fitted camera for ROS, as camera_info YAML and as a static transform.

Use them where other programs need the camera of an arm: image pipelines and tf.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arm.urdf import parse_urdf
from ..body.sensor import SensorPose
from ..body.views import is_camera
from ..errors import OptionError
from ..model.model import Model


def camera_info(model: Model) -> str:
    """The lens as the YAML that ROS's camera_info_manager reads.

    Raises OptionError if the model was not learned from pixels of an arm in space.
    """
    structure: Any = model.body.structure if model.body is not None else None
    if model.body is None or not is_camera(structure.view):
        raise OptionError(
            "the model has no camera: expected one that was learned from pixels of an arm in space"
        )
    f, u, v, k1 = model.body.beta[structure.groups["lens"]].tolist()
    width, height = model.about.picture or (round(2 * u), round(2 * v))
    lens = np.array([[f, 0.0, u], [0.0, f, v], [0.0, 0.0, 1.0]])
    matrices = {
        "camera_matrix": lens,
        "distortion_coefficients": np.array([[k1, 0.0, 0.0, 0.0, 0.0]]),
        "rectification_matrix": np.eye(3),
        "projection_matrix": np.column_stack([lens, np.zeros(3)]),
    }
    told = [f"image_width: {width}", f"image_height: {height}", "camera_name: camera"]
    told.append("distortion_model: plumb_bob")
    for name, matrix in matrices.items():
        rows, columns = matrix.shape
        data = matrix.ravel().tolist()
        told += [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: {data!r}"]
    return "\n".join(told) + "\n"


def static_transform(model: Model) -> str:
    """The sensor's place as a geometry_msgs/TransformStamped in JSON, from the robot's root link.

    The child is the frame that the log names, as a bag does. A camera's frame is optical: x right,
    y down, z ahead.

    Raises OptionError if the model knows no sensor in space.
    """
    sensor = SensorPose.of(model.body)
    if sensor is None:
        raise OptionError(
            "the model knows no sensor's pose: expected one that was learned from a log of an arm "
            "in space and its robot"
        )
    structure: Any = model.body and model.body.structure
    root = parse_urdf(model.about.urdf, model.about.robot).root
    child = model.about.frame or ("camera_optical_frame" if structure.camera else "sensor_frame")
    placed = stamped(root, child, sensor.position.tolist(), sensor.quaternion.tolist())
    return json.dumps(placed, indent=2) + "\n"


def stamped(
    parent: str, child: str, position: Sequence[float], quaternion: Sequence[float]
) -> dict[str, Any]:
    """A geometry_msgs/TransformStamped of a position [m] and a quaternion x, y, z, w."""
    place = {
        "translation": dict(zip("xyz", position, strict=True)),
        "rotation": dict(zip("xyzw", quaternion, strict=True)),
    }
    return {"header": {"frame_id": parent}, "child_frame_id": child, "transform": place}
