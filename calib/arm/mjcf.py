"""MJCF: a model of hinges and slides, read by MuJoCo, as the tree of links and joints of a URDF.

A body is a link.  Its joints turn it about their own places in turn::

    body = parent T(body) prod_j T(pos_j) J_j(q_j - ref_j) T(-pos_j)

so that each joint but the last has a link of its own, and where the last one does not pass through
the body's origin a fixed joint leads on to the body.  Sites are links on fixed joints.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..common.arrays import Array
from ..common.wording import INSTALL, quoted
from ..errors import RobotError
from .robot_text import Vector
from .rotations import exponential, matrix_of
from .urdf import Joint, Range, Urdf

WORLD = "world"
"""The root link."""

_KINEMATIC = ("compiler", "default", "worldbody", "include")
_SHAPES = ("geom", "camera", "light")
_COMPILER = {
    "inertiafromgeom": "false",  # the shapes are left out
    "fusestatic": "false",
    "balanceinertia": "true",
    # MuJoCo moves no body without a mass [kg, kg m2]
    "boundmass": "1e-12",
    "boundinertia": "1e-12",
    "settotalmass": "-1",
}
_LEAST_MASS = 1e-9  # [kg], that a body states


class Placed(NamedTuple):
    """The element that places a joint: ``origin = element after``."""

    tag: str
    name: str
    after: Array  # (4, 4), from the element to the joint's origin


class Mjcf(NamedTuple):
    """A model as a tree of links, and where its text places each joint."""

    tree: Urdf
    # by the names of joints; not of a body's further joints
    places: Mapping[str, Placed]


def read_mjcf(root: ET.Element, name: str = "robot") -> Mjcf:
    """Read a MuJoCo model's links and joints.

    name : name to use where the model has none
    Raises RobotError: what MuJoCo refuses in it, or a joint of several values.
    """
    model = _compiled(root)
    if model.nbody == 1:
        raise RobotError(
            "the MJCF has no bodies: expected a robot with bodies and joints"
        )
    links = [WORLD]
    joints: list[Joint] = []
    masses: dict[str, tuple[float, Vector]] = {}
    places: dict[str, Placed] = {}

    def new_link(name: str, kind: str) -> str:
        # MuJoCo lets a site have a body's name
        links.append(f"{name}:{kind}" if name in links else name)
        return links[-1]

    names = {0: WORLD}
    for number in range(1, model.nbody):
        body = model.body(number)
        link = names[int(body.parentid[0])]
        name_of_body = body.name or f"body_{number}"
        names[number] = new_link(name_of_body, "body")
        if body.mass[0] > _LEAST_MASS:
            masses[names[number]] = float(body.mass[0]), tuple(body.ipos)
        origin = _transform(matrix_of(np.roll(body.quat, -1)), body.pos)
        first = int(body.jntadr[0])
        count = int(body.jntnum[0])
        for index in range(first, first + count):
            part = model.joint(index)
            parent = link
            link = names[number]
            joint = _joint(part)
            if index == first:
                places[joint.name] = Placed("body", body.name, joint.origin)
            if index < first + count - 1 or part.pos.any():
                link = new_link(f"{link}:{joint.name}", "link")
            place = origin @ joint.origin
            joints.append(
                replace(joint, parent=parent, child=link, origin=place)
            )
            origin = _transform(np.eye(3), -part.pos)
        if link != names[number]:
            fixed = f"{names[number]}:frame"
            joints.append(Joint(fixed, "fixed", link, names[number], origin))
            if not count:
                places[fixed] = Placed("body", body.name, np.eye(4))
    for number in range(model.nsite):
        site = model.site(number)
        if site.name:
            body_link = names[int(site.bodyid[0])]
            link = new_link(site.name, "site")
            origin = _transform(matrix_of(np.roll(site.quat, -1)), site.pos)
            joint = Joint(f"{link}:site", "fixed", body_link, link, origin)
            joints.append(joint)
            places[joint.name] = Placed("site", site.name, np.eye(4))
    title = root.get("model", "").strip() or name
    tree = Urdf(title, WORLD, tuple(links), tuple(joints), (), masses)
    return Mjcf(tree, places)


def _compiled(root: ET.Element) -> Any:
    """The model as MuJoCo reads it, without what has no part in its kinematics."""
    try:
        import mujoco
    except ImportError:
        raise RobotError(
            f"a MuJoCo model is read by MuJoCo: {INSTALL.format('mjcf')}"
        ) from None
    text = ET.tostring(root)
    bare = ET.fromstring(text)  # noqa: S314 - written by the line before
    for node in [*bare]:
        if node.tag not in _KINEMATIC:
            bare.remove(node)
    for node in [*bare.iter()]:
        node.attrib.pop("material", None)
        for shape in [*node]:
            if shape.tag in _SHAPES and node.tag != "default":
                node.remove(shape)
    ET.SubElement(bare, "compiler", _COMPILER)
    try:
        return mujoco.MjModel.from_xml_string(ET.tostring(bare, "unicode"))
    except ValueError as error:
        words = " ".join(str(error).split())
        raise RobotError(f"MuJoCo refuses the model: {words}") from None


def _joint(part: Any) -> Joint:
    """A joint of a model; its origin is in its body's frame, with the joint at zero."""
    kinds = {2: "prismatic", 3: "continuous"}
    kind = kinds.get(int(part.type[0]), "")
    name = part.name or f"joint_{part.id}"
    if not kind:
        raise RobotError(
            f"joint {quoted(name)} is a free or a ball joint: expected an arm of hinges and "
            "slides; remove the joint, or the body that it moves"
        )
    limits: Range | None = None
    if part.limited[0]:
        lower, upper = part.range.tolist()
        limits = lower, upper
    back = -float(part.qpos0[0]) * part.axis
    origin = _transform(np.eye(3), part.pos)
    if kind == "prismatic":
        origin[:3, 3] += back
    else:
        origin[:3, :3] = exponential(back)
        if limits is not None:
            kind = "revolute"
    axis = tuple(part.axis.tolist())
    return Joint(name, kind, "", "", origin, axis, limits)


def _transform(rotation: Array, place: Array) -> Array:
    """Transform (4, 4) of a rotation (3, 3) and a place (3,)."""
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = place
    return transform
