"""What a model knows, in the files of others: C, ROS, Universal Robots, MuJoCo, LeRobot."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..arm.description import parse_robot
from ..arm.rotations import quaternion_of
from ..body.corners import held_of
from ..body.sensor_pose import SensorPose
from ..body.views import is_camera
from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.wording import one_line
from ..errors import OptionError
from ..model.header import Header
from ..model.model import Model
from ..model_file.storage import to_bytes
from .correct import usual_limit
from .geometry_fit import fit_geometry
from .urdf import corrected_urdf


def c_header(
    model: Model, *, prefix: str = "calib_", single: bool = False, small: bool = False
) -> tuple[str, int]:
    """One C99 header (also valid C++) that answers as the model does, and its tables' bytes.

    model : with a body, planar or spatial
    prefix : starts every name
    single : ``float`` instead of ``double``, for microcontrollers
    small : the body alone, without tables of bounds, local models and starts: joints are found
        near to others, and there is no expected error
    Raises OptionError if the model has no body, or the prefix is no C name.
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,40}", prefix):
        raise OptionError(f"prefix {prefix!r}: expected a C name such as 'calib_'")
    with one_blas_thread():  # the same bytes on any number of cores
        header = Header.of(model, small=small)
        if header.nominal is not None:
            header = replace(header, limit=usual_limit(model))
    about = model.about
    joints = zip(about.joint_names, about.lower, about.upper, strict=True)
    lines = [
        f" *   {_comment(name)}: {low:.6g} to {high:.6g}" for name, low, high in joints
    ]
    told = {
        "title": _comment(f"{about.robot or 'An arm'}, calibrated"),
        "checksum": hashlib.sha256(to_bytes(model)).hexdigest(),
        "facts": " * Joints, base to tip:\n" + "\n".join(lines) + "\n",
        "unit": _comment(about.unit),
        "bound_of": _comment(about.bound_of),
    }
    text, tables = header.text(prefix, single, told)
    # numbers of the tables: double ones have a point and no suffix
    numbers = re.findall(r"(?<=[\s{])-?\d[\d.e+-]*f?(?=[,}])", tables)
    return text, sum(
        4 if n.endswith("f") or not re.search("[.e]", n) else 8 for n in numbers
    )


def _comment(text: str) -> str:
    """Text of a stranger's file that cannot end a C comment or start a trigraph."""
    return (
        one_line(text)
        .replace("*", "x")
        .replace("/", "-")
        .replace("?", "-")
        .replace("\\", "-")
    )


def camera_info(model: Model) -> str:
    """The lens as the YAML that ROS's camera_info_manager reads.

    Raises OptionError if the model was not learned from pixels of an arm in space.
    """
    body = model.body
    seen = model.about.options.get("board")
    if seen:
        (fx, fy), (u, v), distortion = (
            seen["lens"][k] for k in ("focal", "centre", "distortion")
        )
        width, height = seen["size"]
    elif body is not None and is_camera(body.structure.view):
        fx, u, v, k1 = body.beta[body.structure.groups["lens"]].tolist()
        fy = fx
        distortion = [k1, 0.0, 0.0, 0.0, 0.0]
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
        told += [
            f"{name}:",
            f"  rows: {rows}",
            f"  cols: {columns}",
            f"  data: {data!r}",
        ]
    return "\n".join(told) + "\n"


def static_transform(model: Model) -> str:
    """The sensor's place as a geometry_msgs/TransformStamped in JSON, from the robot's root link.

    The child is the frame that the log names, as a bag does. A camera's frame is optical: x right,
    y down, z ahead. Of a model of pictures of a board both transforms, see `hand_eye_transforms`.

    Raises OptionError if the model knows no sensor in space.
    """
    sensor = SensorPose.of(model.body)
    body = model.body
    about = model.about
    if sensor is None or body is None:
        raise OptionError(
            "the model knows no sensor's pose: expected one that was learned from a log of an arm "
            "in space and its robot"
        )
    placed = {
        "position": sensor.position.tolist(),
        "quaternion": sensor.quaternion.tolist(),
    }
    if seen := about.options.get("board"):
        held = held_of(body)  # of the point that the log tells
        position = (held.position - held.rotation @ seen["point"]).tolist()
        hand = {"position": position, "quaternion": held.quaternion.tolist()}
        return hand_eye_transforms(about.urdf, about.tip, seen["eye"], hand, placed)
    camera = is_camera(body.structure.view)
    child = about.frame or ("camera_optical_frame" if camera else "sensor_frame")
    root = parse_robot(about.urdf, about.robot).root
    return json.dumps(_stamped(root, child, placed), indent=2) + "\n"


def hand_eye_transforms(
    urdf: str, tip: str, eye: str, hand: Mapping[str, Any], base: Mapping[str, Any]
) -> str:
    """What is in the hand in the tip's frame, and what stands still in the root link's, in JSON.

    `hand` and `base` have "position" [m] and "quaternion" (x, y, z, w).  The camera's frame is
    optical; the board's has its origin in a corner, x right, y down.
    """
    carried, still = ("camera", "board") if eye == "hand" else ("board", "camera")
    root = parse_robot(urdf).root
    made = [
        _stamped(tip, f"{carried}_frame", hand),
        _stamped(root, f"{still}_frame", base),
    ]
    return json.dumps(made, indent=2) + "\n"


def _stamped(parent: str, child: str, at: Mapping[str, Any]) -> dict[str, Any]:
    place = {
        "translation": dict(zip("xyz", at["position"], strict=True)),
        "rotation": dict(zip("xyzw", at["quaternion"], strict=True)),
    }
    return {"header": {"frame_id": parent}, "child_frame_id": child, "transform": place}


def corrected_arm(model: Model, *, drawn: bool = False) -> tuple[str, dict[str, float]]:
    """Return the text that `calib urdf` writes, and what is added to each joint's value [rad or m].

    drawn : whether the drawing's lengths and axes are true and joints' zeros alone are fitted

    Raises RobotError or OptionError where geometry does not describe the model.
    """
    geometry = fit_geometry(model, drawn=drawn)
    offsets = {name: float(offset.value) for name, offset in geometry.offsets().items()}
    return corrected_urdf(geometry), offsets


def mjcf_text(urdf: str, tip: str) -> str:
    """Bodies, joints and the tip's site, as a MuJoCo model without shapes."""
    root = ElementTree.Element("mujoco", model="corrected")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    body = ElementTree.SubElement(root, "worldbody")
    for joint in parse_robot(urdf).path(tip):
        x, y, z, w = quaternion_of(joint.rotation).tolist()
        place = {"pos": _text(joint.xyz), "quat": _text((w, x, y, z))}
        body = ElementTree.SubElement(body, "body", {"name": joint.child, **place})
        # a body that moves needs a mass; the true ones belong to the arm's own file
        ElementTree.SubElement(
            body, "inertial", pos="0 0 0", mass="1", diaginertia=".01 .01 .01"
        )
        if joint.movable:
            kind = "hinge" if joint.revolute else "slide"
            told = {"name": joint.name, "type": kind, "axis": _text(joint.axis)}
            if joint.limits is not None:
                told["range"] = _text(joint.limits)
            ElementTree.SubElement(body, "joint", told)
    ElementTree.SubElement(body, "site", name=tip)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _text(values: Array | tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)
