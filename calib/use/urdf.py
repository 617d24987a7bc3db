"""Corrected URDF: a copy of the text whose joint origins describe the arm as it really is.

Only the origins that change are rewritten; comments, other elements and the layout stay.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np

from ..arm.arm import PlanarArm
from ..arm.description import parse_robot
from ..arm.posture import posture_of
from ..arm.rigid import rigid
from ..arm.robot_text import MJCF, parse_xml
from ..arm.spatial_chain import move
from ..arm.urdf import Urdf
from ..common.arrays import Array
from ..common.wording import for_people
from ..errors import OptionError, RobotError
from .edits import with_origins
from .geometry import MOST_UNEXPLAINED, Geometry
from .settings import FITTING


def corrected_urdf(geometry: Geometry) -> str:
    """Text of the nominal URDF (or MJCF) with corrected joint origins.

    A joint's offset becomes a turn of its origin about its axis (or a shift along it, if it
    slides), a displacement a shift of the origin of the joint that it moves; the tip's
    displacement that of the joint which carries the tip.

    Raises RobotError if the geometry does not describe the model to `MOST_UNEXPLAINED` of its
    reach, or the tip has no own joint that could be moved.
    """
    if not geometry.is_explained:
        share = geometry.residual / geometry.reach
        factor, unit = for_people(geometry.unit)
        raise RobotError(
            f"joint offsets and link placements leave {factor * geometry.residual:.4g} {unit} rms "
            f"unexplained, {100.0 * share:.3g} % of the reach (at most {MOST_UNEXPLAINED:.0%})",
            hint="check the joints and their senses, the tip and the unit of the log; a log in "
            "the root frame needs `view='base'` in training, one in a sensor's must not have it",
        )
    text = geometry.arm.urdf
    tree = parse_robot(text)
    drawn = {joint.name: joint.origin for joint in tree.joints}
    moved = {}
    for name, origin in _origins(geometry, tree).items():
        if np.abs(drawn[name] - origin).max() > FITTING.tiny:
            moved[name] = origin
    return with_origins(text, moved)


def gap_to_yourdfpy(text: str, tip: str) -> float:
    """How far [m] yourdfpy places a tip from where calib does, joints at their neutral values.

    An MJCF, which yourdfpy does not read, has no gap.
    """
    if parse_xml(text).tag == MJCF:
        return 0.0
    from yourdfpy import URDF

    urdf = parse_robot(text)
    values = urdf.values({})
    robot = URDF.load(BytesIO(text.encode()), load_meshes=False)
    robot.update_cfg(
        {name: values[name] for name in robot.actuated_joint_names}
    )
    there = robot.get_transform(tip, urdf.root)
    here = posture_of(urdf, values).frames[tip]
    return float(np.linalg.norm(there[:3, 3] - here[:3, 3]))


def _origins(geometry: Geometry, urdf: Urdf) -> dict[str, Array]:
    """Origins (4, 4) of the joints from the root to the tip with which all links are as fitted."""
    arm = geometry.arm
    path = urdf.path(arm.tip)
    last = path[-1]
    deviations = geometry.structure.deviations(geometry.beta)
    moves = last.kind != "prismatic" and deviations.tool.any()
    is_planar = isinstance(arm, PlanarArm)
    if is_planar and moves and last.name in geometry.fitted_joints:
        raise RobotError(
            f"the tip {arm.tip!r} is the origin of joint {last.name!r}: it has no link of its "
            "own that could be corrected",
            hint="name another `tip`",
            parameter="tip",
            value=arm.tip,
        )
    values = {**arm.locked, **dict.fromkeys(geometry.fitted_joints, 0.0)}
    drawn = posture_of(urdf, values).frames
    fitted = _fitted_frames(geometry, urdf, drawn)
    origins = {}
    for joint in path:  # a locked joint's own motion stays behind its origin
        lock = np.linalg.solve(
            drawn[joint.child], drawn[joint.parent] @ joint.origin
        )
        origin = np.linalg.solve(fitted[joint.parent], fitted[joint.child])
        origins[joint.name] = origin @ lock
    return origins


def _fitted_frames(
    geometry: Geometry, urdf: Urdf, drawn: Mapping[str, Array]
) -> dict[str, Array]:
    """Frames (4, 4) of the links to the tip where joints read zero, as fitted.

    drawn : the same by the drawing
    """
    arm = geometry.arm
    structure = geometry.structure
    beta = geometry.beta
    offsets = structure.chain.coupling @ beta[structure.groups["offset"]]
    motion = move(structure.links(beta), offsets[:, None])
    carried = np.eye(4)
    fitted = {urdf.root: np.eye(4)}
    for joint in urdf.path(arm.tip):
        if joint.name in geometry.fitted_joints:
            k = geometry.fitted_joints.index(joint.name)
            frame = rigid(motion.frames[k + 1, :, :, 0], motion.places[k, :, 0])
            carried = frame @ rigid(np.eye(3), -structure.chain.points[k])
        fitted[joint.child] = carried @ drawn[joint.child]
    if isinstance(arm, PlanarArm):
        # in space the sensed point is a probe or a tag, not the tip
        fitted[arm.tip] = rigid(motion.rotation[:, :, 0], motion.position[:, 0])
    return fitted


def check_output(path: str, nominal: str) -> None:
    """Refuse to write over the URDF that the model was made with.

    Raises OptionError if the file at `path` is that URDF.
    """
    old = ""
    with suppress(OSError, UnicodeDecodeError):
        old = Path(path).read_text(encoding="utf-8-sig").strip()
    if old and old == nominal.strip():
        raise OptionError(
            f"{path} is the URDF that the model was made with, which is never overwritten",
            hint="write the corrected one into another file",
            parameter="output",
            value=path,
        )
