"""Camera files: a fitted camera for ROS, as camera_info YAML and as a static transform.

Use them where other programs need the camera of an arm: image pipelines and tf.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arm.urdf import parse_urdf
from ..body.corners import held_of
from ..body.sensor import SensorPose
from ..body.views import is_camera
from ..errors import OptionError
from ..model.model import Model


def camera_info(model: Model) -> str:
    """The lens as the YAML that ROS's camera_info_manager reads.

    Raises OptionError if the model was not learned from pixels of an arm in space.
    """
    body, seen = model.body, _seen(model)
    if seen:
        (fx, fy), (u, v), distortion = (seen["lens"][k] for k in ("focal", "centre", "distortion"))
        width, height = seen["size"]
    elif body is not None and is_camera(body.structure.view):
        fx, u, v, k1 = body.beta[body.structure.groups["lens"]].tolist()
        fy, distortion = fx, [k1, 0.0, 0.0, 0.0, 0.0]
        width, height = model.about.picture or (round(2 * u), round(2 * v))
    else:
        raise OptionError(
            "the model has no camera: expected one that was learned from pixels of an arm in space"
        )
    lens = np.array([[fx, 0.0, u], [0.0, fy, v], [0.0, 0.0, 1.0]])
    matrices = {
        "camera_matrix": lens,
        "distortion_coefficients": np.array([distortion]),
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
    y down, z ahead. Of a model of pictures of a board both transforms, see `hand_eye_transforms`.

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
    if model.body is not None and (seen := _seen(model)):
        held = held_of(model.body)  # of the point that the log tells
        position = held.position - held.rotation @ seen["point"]
        hand = {"position": position.tolist(), "quaternion": held.quaternion.tolist()}
        base = {"position": sensor.position.tolist(), "quaternion": sensor.quaternion.tolist()}
        return hand_eye_transforms(model.about.tip, root, seen["eye"], hand, base)
    child = model.about.frame or ("camera_optical_frame" if structure.camera else "sensor_frame")
    placed = _stamped(root, child, sensor.position.tolist(), sensor.quaternion.tolist())
    return json.dumps(placed, indent=2) + "\n"


def hand_eye_transforms(
    tip: str, root: str, eye: str, hand: Mapping[str, Any], base: Mapping[str, Any]
) -> str:
    """What is in the hand in the tip's frame, and what stands still in the root link's, in JSON.

    The camera's frame is optical; the board's has its origin in a corner, x right, y down.
    """
    carried, still = ("camera", "board") if eye == "hand" else ("board", "camera")
    placed = ((tip, carried, hand), (root, still, base))
    made = [_stamped(a, f"{b}_frame", at["position"], at["quaternion"]) for a, b, at in placed]
    return json.dumps(made, indent=2) + "\n"


def _seen(model: Model) -> dict[str, Any]:
    """How a model's pictures of a board were taken, empty if it is none of such."""
    return dict(model.about.options.get("board") or {})


def _stamped(
    parent: str, child: str, position: Sequence[float], quaternion: Sequence[float]
) -> dict[str, Any]:
    """A geometry_msgs/TransformStamped of a position [m] and a quaternion x, y, z, w."""
    place = {
        "translation": dict(zip("xyz", position, strict=True)),
        "rotation": dict(zip("xyzw", quaternion, strict=True)),
    }
    return {"header": {"frame_id": parent}, "child_frame_id": child, "transform": place}
