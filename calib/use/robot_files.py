"""The corrected arm in the files of others: Universal Robots' kinematics, MuJoCo's bodies."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from ..arm.tree import Joint
from ..arm.urdf import parse_urdf
from ..common.arrays import Array
from ..errors import OptionError
from .geometry import fit_geometry
from .urdf import corrected_urdf

if TYPE_CHECKING:
    from ..model.model import Model

_UR = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


@dataclass(frozen=True)
class CorrectedArm:
    """The arm as a model knows it."""

    urdf: str  # the text that `calib urdf` writes
    tip: str
    offsets: dict[str, float]  # by joint what is added to its logged value [rad or m]

    def joints(self) -> list[Joint]:
        """Joints from the root to the tip."""
        return list(parse_urdf(self.urdf).path(self.tip))


def corrected_arm(model: Model) -> CorrectedArm:
    """The corrected arm; RobotError or OptionError where geometry does not describe the model."""
    geometry = fit_geometry(model)
    told = geometry.to_json()["offsets"]
    offsets = {name: float(np.ravel(each["value"])[0]) for name, each in told.items()}
    return CorrectedArm(corrected_urdf(geometry), geometry.arm.tip, offsets)


def ur_kinematics(arm: CorrectedArm) -> str:
    """The `kinematics:` entries that Universal Robots' ROS 2 description reads.

    They are the origins of the six joints, as in `ur_description/config/*/default_kinematics.yaml`.
    Raises OptionError if the arm has other than six turning joints.
    """
    joints = [joint for joint in arm.joints() if joint.movable]
    if len(joints) != len(_UR) or not all(joint.revolute for joint in joints):
        raise OptionError(
            f"{len(joints)} joints lead to {arm.tip}: expected the six turning ones of a UR"
        )
    lines = ["kinematics:"]
    for name, joint in zip(_UR, joints, strict=True):
        lines.append(f"  {name}:")
        values = zip(("x", "y", "z", "roll", "pitch", "yaw"), (*joint.xyz, *joint.rpy), strict=True)
        lines += [f"    {key}: {float(value)!r}" for key, value in values]
    digest = hashlib.sha256("\n".join(lines).encode()).hexdigest()[:20]
    return "\n".join([*lines, f"  hash: calib_{digest}"]) + "\n"


def mjcf_text(arm: CorrectedArm) -> str:
    """Bodies, joints and the tip's site, as a MuJoCo model without shapes."""
    root = ElementTree.Element("mujoco", model="corrected")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    body = ElementTree.SubElement(root, "worldbody")
    for joint in arm.joints():
        body = ElementTree.SubElement(body, "body", {"name": joint.child, **_placed(joint)})
        # a body that moves needs a mass; the true ones belong to the arm's own file
        ElementTree.SubElement(body, "inertial", pos="0 0 0", mass="1", diaginertia=".01 .01 .01")
        if joint.movable:
            kind = "hinge" if joint.revolute else "slide"
            told = {"name": joint.name, "type": kind, "axis": _text(joint.axis)}
            if joint.limits is not None:
                told["range"] = _text(joint.limits)
            ElementTree.SubElement(body, "joint", told)
    ElementTree.SubElement(body, "site", name=arm.tip)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _placed(joint: Joint) -> dict[str, str]:
    """Where a body stands in its parent: `pos` [m] and `quat` (w, x, y, z)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_euler("xyz", joint.rpy).as_quat()
    return {"pos": _text(joint.xyz), "quat": _text((w, x, y, z))}


def _text(values: Array | tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in np.asarray(values, float))
