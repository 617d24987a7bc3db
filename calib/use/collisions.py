"""Collisions: poses in which an arm hits itself, or whose tip is outside of a camera's picture."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.arm import Arm
from ..body.views import is_camera
from ..common.arrays import Array
from ..model.model import Model
from ..model.nominal import moves_in_space
from ..model.space import Space
from .pose_space import PoseSpace

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
        # a joint without limits has cosine and sine as its configuration: `integrate` fills both
        velocity = np.zeros(model.nv)
        for name, value in {**locked, **dict(zip(joint_names, values, strict=True))}.items():
            velocity[model.joints[model.getJointId(name)].idx_v] = value
        at = pin.integrate(model, pin.neutral(model), velocity)
        pin.computeCollisions(model, data, bodies, results, at, False)
        row[:] = [found.isCollision() for found in results.collisionResults]
    moved = np.array([(joints[i], joints[k]) for i, k in pairs]).reshape(-1, 2)
    often = moved[met[:_TRIED].mean(axis=0) >= _ALWAYS]
    compared = ~(moved[:, None] == often[None]).all(axis=2).any(axis=1)
    return np.asarray(met[:, compared].any(axis=1)) if compared.any() else None


def in_picture(source: Arm | Model, space: PoseSpace, points: Array) -> tuple[Array, list[str]]:
    """The candidates whose tip lies within the picture of a model's camera, and what was left out.

    What a link hides is not looked for: see that the tip is in sight.
    """
    if isinstance(source, Arm) or source.body is None or not is_camera(source.body.structure.view):
        return points, []
    chain = Space.of(source)
    seen = chain.sees(chain.evaluate(space.scale.from_unit(points))[0])
    if not seen.any():
        return points, ["the camera sees the tip in none of the poses: look where it stands"]
    return points[seen], [
        f"{1 - seen.mean():.0%} of the candidates were left out because the tip is outside of the "
        "camera's picture there; that a link hides it is not checked"
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
