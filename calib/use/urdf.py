"""Corrected URDF: a copy of the text whose joint origins describe the arm as it really is.

Only the origins that change are rewritten; comments, other elements and the layout stay.
"""

from __future__ import annotations

import re
import warnings
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from ..arm.description import parse_robot
from ..arm.mjcf import read_mjcf
from ..arm.posture import origin_of, posture_of
from ..arm.spatial_chain import move
from ..arm.urdf import MJCF, Joint, Urdf, parse_xml
from ..common.arrays import Array
from ..common.wording import for_people, listed
from ..errors import OptionError, RobotError
from .mjcf import corrected_mjcf

if TYPE_CHECKING:
    from ..model.model import Model
    from .geometry import Geometry

MOST_UNEXPLAINED = 0.01
"""Share of the arm's reach that a geometry may leave unexplained."""

_CLEARLY = 3.0  # sds by which a parameter has to be off
_TINY = 1e-12  # [m or rad]; a smaller change is rounding
_SAME = 1e-9  # of an origin's numbers: what rounding of roll, pitch and yaw leaves

_TAG = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")


def corrected_urdf(geometry: Geometry) -> str:
    """Text of the nominal URDF (or MJCF) with corrected joint origins.

    A joint's offset becomes a turn of its origin about its axis (or a shift along it, if it
    slides), a displacement a shift of the origin of the joint that it moves; the tip's
    displacement that of the joint which carries the tip.

    Raises RobotError if the geometry does not describe the model to `MOST_UNEXPLAINED` of its
    reach, or the tip has no joint of its own that could be moved.
    """
    share = geometry.residual / geometry.reach
    if not share <= MOST_UNEXPLAINED:
        factor, unit = for_people(geometry.unit)
        raise RobotError(
            f"joint offsets and link placements leave {factor * geometry.residual:.4g} {unit} rms "
            f"unexplained, {100.0 * share:.3g} % of the reach (at most {MOST_UNEXPLAINED:.0%})",
            hint="check the joints, the tip and the unit of the log; a log in the robot's root "
            "frame needs `view='base'`, one in a sensor's frame must not have it",
        )
    urdf = parse_robot(geometry.arm.urdf)
    origins = _origins(geometry, urdf)
    path = urdf.path(geometry.arm.tip)
    root = parse_xml(geometry.arm.urdf)
    if root.tag == MJCF:
        return corrected_mjcf(geometry.arm.urdf, read_mjcf(root), origins)
    changed = {joint.name: _changed(joint, origins[joint.name]) for joint in path}
    text = _edited(geometry.arm.urdf, changed)
    _read_back(text, origins)
    return text


def _origins(geometry: Geometry, urdf: Urdf) -> dict[str, Array]:
    """Origins (4, 4) of the joints from the root to the tip with which all links are as fitted."""
    arm = geometry.arm
    structure = geometry.structure
    beta = geometry.beta
    path = urdf.path(arm.tip)
    tool = structure.deviations(beta)
    moves = tool.tool_turn.any() or (tool.tool.any() and path[-1].kind != "prismatic")
    if geometry.move_tip and moves and path[-1].name in geometry.places:
        raise RobotError(
            f"the tip {arm.tip!r} is the origin of joint {path[-1].name!r}: it has no link of its "
            "own that could be corrected",
            hint="name another `tip`",
            parameter="tip",
            value=arm.tip,
        )
    drawn = posture_of(
        urdf, {**arm.locked, **dict.fromkeys(geometry.places, 0.0)}
    ).frames
    offsets = structure.chain.coupling @ beta[structure.groups["offset"]]
    motion = move(structure.links(beta), offsets[:, None])
    carried = np.eye(4)
    fitted = {urdf.root: np.eye(4)}
    for joint in path:
        if joint.name in geometry.places:
            k = geometry.places.index(joint.name)
            carried = _placed(motion.places[k, :, 0], motion.frames[k + 1, :, :, 0])
            carried = carried @ _placed(-structure.chain.points[k], np.eye(3))
        fitted[joint.child] = carried @ drawn[joint.child]
    if geometry.move_tip:
        fitted[arm.tip] = _placed(motion.position[:, 0], motion.rotation[:, :, 0])
    origins = {}
    for joint in path:  # a locked joint's own motion stays behind its origin
        lock = (
            np.linalg.inv(drawn[joint.child]) @ drawn[joint.parent] @ origin_of(joint)
        )
        origins[joint.name] = (
            np.linalg.inv(fitted[joint.parent]) @ fitted[joint.child] @ lock
        )
    return origins


def _read_back(text: str, origins: dict[str, Array]) -> None:
    """Let a second reader, yourdfpy, find the joints' origins (4, 4) in what is to be written."""
    import yourdfpy

    try:
        read = yourdfpy.URDF.load(
            BytesIO(text.encode()), build_scene_graph=False
        ).joint_map
    except (AttributeError, KeyError, TypeError, ValueError):
        return  # it knows fewer shapes than URDFs hold, and says so by whatever its parser raises
    for name, origin in origins.items():
        found = np.eye(4) if read[name].origin is None else read[name].origin
        if np.abs(found - origin).max() > _SAME * max(1.0, np.abs(origin).max()):
            raise RobotError(
                f"joint {name!r}: yourdfpy reads another origin than was written"
            )


def _edited(text: str, origins: dict[str, dict[str, Array]]) -> str:
    """Return a URDF's text with other "xyz" [m] and "rpy" [rad] of joints, all else as it was."""
    data = text.encode()
    path = list[str]()
    found: dict[
        str, tuple[int, dict[str, str] | None]
    ] = {}  # of each joint, its origin's place
    reader = expat.ParserCreate("utf-8")

    def start(tag: str, given: dict[str, str]) -> None:
        path.append(tag)
        if path == ["robot", "joint"]:
            found[given["name"]] = reader.CurrentByteIndex, None
        elif path == ["robot", "joint", "origin"]:
            found[list(found)[-1]] = reader.CurrentByteIndex, given

    reader.StartElementHandler = start
    reader.EndElementHandler = lambda _: path.pop()
    reader.Parse(data, True)
    for name, (place, given) in reversed(found.items()):
        if not (values := origins.get(name)):
            continue
        tag = _TAG.match(data, place)
        assert tag is not None  # noqa: S101 - expat found one here
        new = {
            key: " ".join(repr(v + 0.0) for v in each.tolist())
            for key, each in values.items()
        }
        inside = " ".join(
            f"{key}={quoteattr(v)}" for key, v in {**(given or {}), **new}.items()
        )
        end = "/>" if given is None or tag[0].endswith(b"/>") else ">"
        begin = tag.end() if given is None else place
        data = data[:begin] + f"<origin {inside}{end}".encode() + data[tag.end() :]
    return data.decode()


def _changed(joint: Joint, moved: Array) -> dict[str, Array]:
    """Return what of a joint's origin differs from `moved` (4, 4)."""
    change: dict[str, Array] = {}
    if np.abs(moved[:3, 3] - joint.xyz).max() > _TINY:
        change["xyz"] = moved[:3, 3]
    if np.abs(moved[:3, :3] - origin_of(joint)[:3, :3]).max() > _TINY:
        from scipy.spatial.transform import Rotation

        with (
            warnings.catch_warnings()
        ):  # at a pitch of 90 deg SciPy sets one of the others to zero
            warnings.simplefilter("ignore", UserWarning)
            change["rpy"] = Rotation.from_matrix(moved[:3, :3]).as_euler("xyz")
    return change


def _placed(shift: Array, turn: Array) -> Array:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn, shift
    return frame


def what_no_urdf_holds(model: Model) -> tuple[str, ...]:
    """Return what the model knows of the arm that origins of joints cannot say, in a note."""
    body = model.body
    if body is None or body.simulated:
        return ()
    groups = body.structure.groups
    kinds = {
        "bends under gravity": body.structure.bending,
        "error curves of joints": tuple(
            name for name in groups if name.startswith("curve")
        ),
        "gears": ("gain",),
        "joints that move with a neighbour's motor": ("coupling",),
    }
    away = (body.beta - body.structure.neutral())[body.active]
    deviation = np.sqrt((body.root**2).sum(axis=1))
    moved = set(body.active[np.abs(away) > _CLEARLY * deviation].tolist())
    names = [
        name
        for name, blocks in kinds.items()
        if any(
            moved & set(groups[block].tolist()) for block in blocks if block in groups
        )
    ]
    if not names:
        return ()
    return (
        f"a URDF cannot hold {listed(names)}: what they do is left over; correcting joints has it",
    )


def check_output(path: str, nominal: str) -> None:
    """Refuse to write over the URDF that the model was made with.

    Raises OptionError if the file at `path` is that URDF.
    """
    same = False
    with suppress(OSError, UnicodeDecodeError):
        same = Path(path).read_text(encoding="utf-8-sig").strip() == nominal.strip()
    if same:
        raise OptionError(
            f"{path} is the URDF that the model was made with, which is never overwritten",
            hint="write the corrected one into another file",
            parameter="output",
            value=path,
        )
