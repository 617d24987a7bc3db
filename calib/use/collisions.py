"""Collisions: postures in which an arm hits itself or hides its tip from a camera or tracker.

Both are found by the collision bodies of its URDF.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.arm import Arm
from ..body.sensor import SensorPose
from ..common.arrays import Array
from ..model.model import Model
from ..model.nominal import moves_in_space
from ..model.space import Space
from .pose_space import PoseSpace

_TRIED, _ALWAYS = 100, 0.9  # postures in which links meet that are built so, and their share

_SIGHT = 1e-3  # m: radius of a line of sight

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

    model, bodies = _bodies(urdf)
    if bodies is None:
        return None
    joints = [body.parentJoint for body in bodies.geometryObjects]
    pairs = [
        (i, k)
        for (i, a), (k, b) in combinations(enumerate(joints), 2)
        if a != b and model.parents[a] != b and model.parents[b] != a
    ]
    for pair in pairs:
        bodies.addCollisionPair(pin.CollisionPair(*pair))
    data, results = model.createData(), pin.GeometryData(bodies)
    met = np.zeros((len(q), len(pairs)), dtype=bool)
    for row, values in zip(met, q, strict=True):
        at = _configuration(pin, model, joint_names, locked, values)
        pin.computeCollisions(model, data, bodies, results, at, False)
        row[:] = [found.isCollision() for found in results.collisionResults]
    moved = [(joints[i], joints[k]) for i, k in pairs]
    often = met[:_TRIED].mean(axis=0) >= _ALWAYS
    built = {pair for pair, always in zip(moved, often, strict=True) if always}
    compared = [k for k, pair in enumerate(moved) if pair not in built]
    return np.asarray(met[:, compared].any(axis=1)) if compared else None


def hides_its_tip(
    urdf: str, names: Sequence[str], locked: Mapping[str, float], q: Array, tips: Array, eye: Array
) -> NDArray[np.bool_]:
    """Whether a link stands between a sensor at `eye` (3,) and the tips (n, 3) [m], (n,).

    The last link carries what is seen and hides nothing.
    """
    import coal  # type: ignore[import-untyped]
    import pinocchio as pin

    hidden = np.zeros(len(q), dtype=bool)
    model, bodies = _bodies(urdf)
    if bodies is None:
        return hidden
    data, places = model.createData(), pin.GeometryData(bodies)
    last = max(model.getJointId(name) for name in names)
    links = [k for k, g in enumerate(bodies.geometryObjects) if g.parentJoint < last]
    for i, (values, tip) in enumerate(zip(q, tips, strict=True)):
        at = _configuration(pin, model, names, locked, values)
        pin.updateGeometryPlacements(model, data, bodies, places, at)
        way = eye - tip
        length = float(np.linalg.norm(way))
        # a capsule lies along z: it is turned into the line of sight
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way).matrix()
        sight, middle = coal.Capsule(_SIGHT, length), coal.Transform3s(turn, tip + 0.5 * way)
        for k in links:
            own = coal.Transform3s(places.oMg[k].rotation, places.oMg[k].translation)
            asked = bodies.geometryObjects[k].geometry, own, sight, middle
            if coal.collide(*asked, coal.CollisionRequest(), coal.CollisionResult()):
                hidden[i] = True
                break
    return hidden


def visible(source: Arm | Model, space: PoseSpace, points: Array) -> tuple[Array, list[str]]:
    """The candidates whose tip a model's camera or tracker sees, and what was left out.

    A laser tracker stands at its frame's origin. An origin within the arm's reach is that of
    another frame, which hides nothing.
    """
    body = None if isinstance(source, Arm) else source.body
    sensor = SensorPose.of(body)
    if isinstance(source, Arm) or body is None or sensor is None or body.structure.view == "base":
        return points, []
    q, chain, about = space.scale.from_unit(points), Space.of(source), source.about
    if not chain.camera and np.linalg.norm(sensor.position) <= chain.length:
        return points, []
    tips = chain.evaluate(q)[0]
    seen = np.flatnonzero(chain.sees(tips))
    asked = about.urdf, about.joint_names, about.locked, q[seen], tips[seen], sensor.position
    seen = seen[~hides_its_tip(*asked)]
    what, where = "tracker at the origin of its frame", "behind a link"
    if chain.camera:
        what, where = "camera", f"outside of its picture, or {where}"
    if not len(seen):
        return points, [f"the {what} sees the tip in none of the poses: look where it stands"]
    left = 1 - len(seen) / len(points)
    if not (left or chain.camera):
        return points, []
    return points[seen], [
        f"{left:.0%} of the candidates were left out because the {what} does not see the tip there "
        f"({where} by the URDF's collision bodies)"
    ]


def apart(source: Arm | Model, space: PoseSpace, points: Array) -> tuple[Array, str]:
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
    # a joint without limits has cosine and sine as its configuration: `integrate` fills in both
    velocity = np.zeros(model.nv)
    for name, value in {**locked, **dict(zip(names, values, strict=True))}.items():
        velocity[model.joints[model.getJointId(name)].idx_v] = value
    return np.asarray(pin.integrate(model, pin.neutral(model), velocity))


def _bodies(urdf: str) -> tuple[Any, Any]:
    """Pinocchio's model and collision bodies, None without two bodies that are in no file."""
    import pinocchio as pin

    root = ET.fromstring(urdf)  # noqa: S314 - a URDF was checked when it was read
    left = 0
    for link in root.iter("link"):
        for body in link.findall("collision"):
            if body.find("geometry/mesh") is not None:
                link.remove(body)
            else:
                left += 1
    text = ET.tostring(root, encoding="unicode")
    try:
        model = pin.buildModelFromXML(text)
        bodies = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    except Exception:  # Pinocchio raises what its parser happened to throw
        return None, None
    return (model, bodies) if left > 1 else (model, None)
