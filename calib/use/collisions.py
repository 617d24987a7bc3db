"""Collisions: postures in which an arm hits itself, by the collision bodies of its URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arm.arm import Arm
from .geometry import moves_in_space
from .pose_space import Space

if TYPE_CHECKING:
    from ..model.model import Model

Array = NDArray[np.float64]

_TRIED, _ALWAYS = 100, 0.9  # postures in which links meet that are built so, and their share

_UNSEEN = "obstacles and self-collision are not checked: move slowly the first time"


def hits_itself(
    urdf: str, joint_names: Sequence[str], locked: Mapping[str, float], q: Array
) -> NDArray[np.bool_] | None:
    """Whether each posture (n, dof) brings two links of the robot together, (n,).

    Links that are joined, and those that meet in nearly all postures, are built so and not
    compared. Meshes are left out: their files are not part of a URDF.

    Returns (n,), None where no two links have collision bodies that could be compared.
    """
    import pinocchio as pin

    text = _without_meshes(urdf)
    if text is None:
        return None
    try:
        model: Any = pin.buildModelFromXML(text)
        bodies: Any = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    except Exception:  # Pinocchio raises what its parser happened to throw
        return None
    bodies.addAllCollisionPairs()
    data = model.createData()
    rows = [_configuration(pin, model, joint_names, locked, values) for values in q]
    results, often = pin.GeometryData(bodies), np.zeros(len(bodies.collisionPairs))
    for at in rows[:_TRIED]:
        pin.computeCollisions(model, data, bodies, results, at, False)
        often += [found.isCollision() for found in results.collisionResults]
    pairs = [(pair.first, pair.second) for pair in bodies.collisionPairs]
    moved = [tuple(bodies.geometryObjects[k].parentJoint for k in pair) for pair in pairs]
    built = {m for m, n in zip(moved, often, strict=True) if n >= _ALWAYS * len(rows[:_TRIED])}
    bodies.removeAllCollisionPairs()
    for pair, (a, b) in zip(pairs, moved, strict=True):
        joined = a == b or model.parents[a] == b or model.parents[b] == a
        if not joined and (a, b) not in built:
            bodies.addCollisionPair(pin.CollisionPair(*pair))
    if not len(bodies.collisionPairs):
        return None
    results = pin.GeometryData(bodies)
    hits = [pin.computeCollisions(model, data, bodies, results, at, True) for at in rows]
    return np.array(hits, dtype=bool)


def apart(source: Arm | Model, space: Space, points: Array) -> tuple[Array, str]:
    """The candidates in which an arm in space does not hit itself, and what was looked at."""
    about = source if isinstance(source, Arm) else source.about
    wide = source.outputs == 3 if isinstance(source, Arm) else moves_in_space(source)
    hits = None
    if wide and about.urdf:
        q = space.scale.from_unit(points)
        hits = hits_itself(about.urdf, space.joint_names, about.locked, q)
    if hits is None or hits.all():
        return points, _UNSEEN
    return points[~hits], (
        f"{hits.mean():.1%} of the candidates were left out because the arm hits itself there "
        "(by the URDF's collision bodies without meshes); obstacles and the moves between poses "
        "are not checked: move slowly the first time"
    )


def _configuration(
    pin: Any, model: Any, names: Sequence[str], locked: Mapping[str, float], values: Array
) -> Array:
    velocity = np.zeros(model.nv)
    for name, value in {**locked, **dict(zip(names, values, strict=True))}.items():
        velocity[model.joints[model.getJointId(name)].idx_v] = value
    return np.asarray(pin.integrate(model, pin.neutral(model), velocity))


def _without_meshes(urdf: str) -> str | None:
    """The URDF without collision bodies in files; None where fewer than two bodies are left."""
    root = ET.fromstring(urdf)  # noqa: S314 - a URDF was checked when it was read
    left = 0
    for link in root.iter("link"):
        for body in link.findall("collision"):
            if body.find("geometry/mesh") is not None:
                link.remove(body)
            else:
                left += 1
    return ET.tostring(root, encoding="unicode") if left > 1 else None
