"""Exports: what a model knows, in formats of C, ROS, MuJoCo."""

import hashlib
import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np

from ..arm.description import parse_robot
from ..arm.rigid import rigid, shift_of, turn_of
from ..arm.rotations import quaternion_of
from ..body.sensor_pose import SensorPose
from ..body.views import is_camera
from ..common.parallel import one_blas_thread
from ..common.wording import one_line
from ..errors import OptionError
from ..model.c_header import Header
from ..model.model import Model
from ..model_file.storage import to_bytes
from ..recording.rig import frames_of_model, stamped
from ..samples.lens import Lens
from .correct import usual_limit
from .edits import number_text, pose_of
from .geometry import Quantity
from .geometry_fit import fit_geometry, seen_in_lengths
from .urdf import corrected_urdf


def c_header(
    model: Model,
    *,
    prefix: str = "calib_",
    single: bool = False,
    small: bool = False,
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
        raise OptionError(
            f"prefix {prefix!r}: expected a C name such as 'calib_'"
        )
    with one_blas_thread():  # the same bytes on any number of cores
        header = Header.of(model, small=small)
        if header.nominal is not None:
            header = replace(header, limit=usual_limit(model))
    about = model.about
    joints = zip(about.joint_names, about.lower, about.upper, strict=True)
    ranges = [
        f" *   {_comment(name)}: {low:.6g} to {high:.6g}\n"
        for name, low, high in joints
    ]
    comments = {
        "title": _comment(f"{about.robot or 'An arm'}, calibrated"),
        "checksum": hashlib.sha256(to_bytes(model)).hexdigest(),
        "facts": f" * Joints, base to tip:\n{''.join(ranges)}",
        "unit": _comment(about.unit),
        "bound_of": _comment(about.bound_of),
    }
    text, tables = header.text(prefix, single, comments)
    size = 0
    for number in re.findall(r"(?<=[\s{])-?\d[\d.e+-]*f?(?=[,}])", tables):
        is_double = not number.endswith("f") and re.search("[.e]", number)
        size += 8 if is_double else 4
    return text, size


def _comment(text: str) -> str:
    """Text of a stranger's file that cannot end a C comment or start a trigraph."""
    return one_line(text).translate(str.maketrans("*/?\\", "x---"))


def camera_info(model: Model) -> str:
    """The lens as the YAML that ROS's camera_info_manager reads.

    Raises OptionError if the model was not learned from pixels of an arm in space.
    """
    lens = _lens_of(model)
    width, height = lens.size
    document: dict[str, object] = {
        "image_width": width,
        "image_height": height,
        "camera_name": "camera",
        "distortion_model": "plumb_bob",
    }
    for name, matrix in {
        "camera_matrix": lens.matrix,
        "distortion_coefficients": lens.distortion[None],
        "rectification_matrix": np.eye(3),
        "projection_matrix": np.column_stack([lens.matrix, np.zeros(3)]),
    }.items():
        rows, columns = matrix.shape
        numbers = matrix.ravel().tolist()
        document[name] = {"rows": rows, "cols": columns, "data": numbers}
    # JSON is YAML, too
    return json.dumps(document, indent=2) + "\n"


def _lens_of(model: Model) -> Lens:
    """The lens of a model of pixels, or of pictures of a board; OptionError of others."""
    body = model.body
    board = model.about.board
    if board:
        return Lens.from_json(board["lens"])
    if body is None or not is_camera(body.structure.view):
        raise OptionError(
            "the model has no camera: expected one that was learned from pixels of an arm in space"
        )
    focal, u, v, k1 = body.beta[body.structure.groups["lens"]].tolist()
    size = model.about.picture or (round(2 * u), round(2 * v))
    return Lens.of(size, np.array([focal, focal, u, v, k1, 0, 0, 0, 0]))


def static_transforms(model: Model) -> list[dict[str, object]]:
    """The sensor's place as a geometry_msgs/TransformStamped, from the robot's root link.

    The child is the frame that the log names, as a bag does. A camera's frame is optical: x right,
    y down, z ahead. Of a model of pictures of a board both transforms: what is in the hand in
    the tip's frame, what is at rest in the root link's; a board's origin is in its corner.

    Raises OptionError if the model knows no sensor in space.
    """
    body = model.body
    about = model.about
    sensor = SensorPose.of(body)
    if sensor is None or body is None:
        raise OptionError(
            "the model knows no sensor's pose: expected one that was learned from a log of an arm "
            "in space and its robot"
        )
    root = parse_robot(about.urdf, about.robot).root
    frames = frames_of_model(model)
    if frames is not None and about.board is not None:
        children = ["camera_frame", "board_frame"]
        if about.board["eye"] == "base":
            children.reverse()
        parents = [about.tip, root]
    else:
        camera = is_camera(body.structure.view)
        child = "camera_optical_frame" if camera else "sensor_frame"
        children = [about.frame or child]
        parents = [root]
        frames = rigid(sensor.rotation, sensor.position)[None]
    return [
        stamped(
            parent,
            child,
            shift_of(frame).tolist(),
            quaternion_of(turn_of(frame)).tolist(),
        )
        for parent, child, frame in zip(parents, children, frames, strict=True)
    ]


def corrected_arm(
    model: Model, *, geometry_is_drawn: bool = False
) -> tuple[str, dict[str, Quantity]]:
    """Return the text that `calib urdf` writes, and what is added to each joint's value [rad or m].

    geometry_is_drawn : see `fit_geometry`
    Raises RobotError or OptionError where geometry does not describe the model.
    """
    seen = seen_in_lengths(model)
    geometry = fit_geometry(seen, geometry_is_drawn=geometry_is_drawn)
    return corrected_urdf(geometry), geometry.offsets()


def mjcf_text(urdf: str, tip: str) -> str:
    """Bodies, joints and the tip's site, as a MuJoCo model without shapes."""
    root = ElementTree.Element("mujoco", model="corrected")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    body = ElementTree.SubElement(root, "worldbody")
    path = parse_robot(urdf).path(tip)
    for joint in path:
        body = ElementTree.SubElement(
            body, "body", {"name": joint.child, **pose_of(joint.origin)}
        )
        # a body that moves needs a mass; the true ones belong to the arm's own file
        ElementTree.SubElement(
            body, "inertial", pos="0 0 0", mass="1", diaginertia=".01 .01 .01"
        )
        if joint.movable:
            kind = "hinge" if joint.revolute else "slide"
            attributes = {
                "name": joint.name,
                "type": kind,
                "axis": number_text(joint.axis),
            }
            if joint.limits is not None:
                attributes["range"] = number_text(joint.limits)
            ElementTree.SubElement(body, "joint", attributes)
    ElementTree.SubElement(body, "site", name=tip)
    coupled = {joint.name: joint.mimic for joint in path if joint.mimic}
    if coupled:
        equality = ElementTree.SubElement(root, "equality")
    for name, mimic in coupled.items():
        line = number_text((mimic.offset, mimic.multiplier, 0.0, 0.0, 0.0))
        ElementTree.SubElement(
            equality, "joint", joint1=name, joint2=mimic.leader, polycoef=line
        )
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"
