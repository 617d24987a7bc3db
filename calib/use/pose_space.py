"""The space of poses: which joint values an arm that is measured may take."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arm.arm import Arm, SpatialArm, clip_range
from ..body.views import is_camera
from ..common.arrays import Array, Mask, Range
from ..common.inputs import joint_numbers, number_rows
from ..common.scale import Scale
from ..common.wording import quoted, suggestion
from ..errors import OptionError
from ..model.model import Model
from ..model.nominal import nominal_arm
from ..model.space import Space
from ..recording.track import usable_rows
from .settings import PLANNING


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """A box of joint values: convex, so a straight move between two of its poses stays within."""

    joint_names: tuple[str, ...]  # base to tip
    lower: Array  # (dof,) [rad or m]
    upper: Array
    # the whole range of each joint, without margins, as the unit box
    scale: Scale

    def start(self, q: ArrayLike | None) -> Array:
        """Joint values (dof,) to set out from, by default zero or what comes nearest to it.

        They may lie within the margins, but not beyond the joints' ranges.
        """
        if q is None:
            return np.asarray(np.clip(0.0, self.lower, self.upper))
        names = self.joint_names
        rows, _ = number_rows(np.ravel(q), names, "start", OptionError)
        values: Array = rows[0]
        low = self.scale.lower
        high = low + self.scale.span
        beyond = np.abs(values - np.clip(values, low, high))
        for k in np.flatnonzero(~(beyond <= 1e-9)):  # NaN, too
            raise OptionError(
                f"`start`: {names[k]} = {values[k]:.6g} is outside of its range "
                f"{low[k]:.6g} to {high[k]:.6g}"
            )
        return values

    def candidates(self, rng: np.random.Generator) -> Array:
        """Joint values (n, dof) to choose from: corners, on faces, and inside."""
        dof = len(self.joint_names)
        corners_of_first = np.array(
            list(np.ndindex(*(2,) * min(dof, PLANNING.corners))), float
        )
        count, first = corners_of_first.shape
        ends_of_others = rng.integers(2, size=(count, dof - first))
        corners = np.hstack([corners_of_first, ends_of_others])

        faces = rng.random((PLANNING.faces, dof))
        rows = np.arange(PLANNING.faces)
        joint_at_end = rng.integers(dof, size=PLANNING.faces)
        faces[rows, joint_at_end] = rng.integers(2, size=PLANNING.faces)

        inside = rng.random((PLANNING.inside, dof))
        shares = np.concatenate([corners, faces, inside])
        return np.asarray(self.lower + (self.upper - self.lower) * shares)


def space_of(
    source: Arm | Model,
    margin: float | Sequence[float] | None = None,
    ranges: Mapping[str, Range] | None = None,
) -> PoseSpace:
    """Return the space of an arm, or of what a model has learned.

    margin : [rad or m], distance from the joints' mechanical limits, for all or for each joint.
        Without it 1 deg (17 mm for a slide), or 2 % of the range if that is less. A model of a log
        without a robot knows no limits: its range is what was measured.
    ranges : [rad or m], part of a joint's range to plan in
    Raises OptionError if a joint is unknown, a range is outside of what there is, or the margins
    leave nothing.
    """
    about = source if isinstance(source, Arm) else source.about
    names = about.joint_names
    scale = Scale.of_range(about.lower, about.upper, about.revolute)
    lower = about.lower.copy()
    upper = about.upper.copy()
    for name, chosen in (ranges or {}).items():
        if name not in names:
            raise OptionError(
                f"`ranges`: {quoted(name)} is no joint here",
                hint=suggestion(name, names),
                parameter="ranges",
                value=name,
            )
        k = names.index(name)
        learned = float(about.lower[k]), float(about.upper[k])
        unit = about.units_of_joints[k]
        lower[k], upper[k] = clip_range(name, chosen, learned, unit)
    margins = np.minimum(PLANNING.margin, PLANNING.share * scale.span)
    if margin is not None:
        margins = joint_numbers("margin", margin, names)
    arm = arm_of(source)
    if arm is not None:
        least, most = np.transpose(arm.limits)
        lower = np.maximum(lower, least + margins)
        upper = np.minimum(upper, most - margins)
    for k in np.flatnonzero(lower >= upper).tolist():
        raise OptionError(
            f"margin {margins[k]:g}: no room is left in {names[k]}'s range "
            f"{about.lower[k]:.6g} to {about.upper[k]:.6g}; expected a smaller one"
        )
    return PoseSpace(names, lower, upper, scale)


def arm_of(source: Arm | Model) -> Arm | None:
    """Return an arm, or the nominal one of a model; None where it knows no URDF."""
    if isinstance(source, Arm):
        return source
    return nominal_arm(source) if source.about.urdf else None


def usable_postures(
    source: Arm | Model, q: Array, height: float | None
) -> tuple[Mask, list[str]]:
    """Whether each posture (n, dof) can be measured, (n,), and notes for the user.

    The arm must not hit itself, a camera has to see its tip, and the arm stays above
    z = `height` [m] of its base frame: the tip and the joints' origins, not links and tools beyond.
    Raises OptionError if a height is given for an arm whose base frame is not known.
    """
    arm = arm_of(source)
    doubts: dict[str, Mask] = {}
    hints: list[str] = []
    unchecked = "obstacles and self-collision"
    if isinstance(arm, SpatialArm):
        hits = hits_itself(arm.urdf, arm.joint_names, arm.locked, q)
        if hits is not None:
            doubts["the arm hits itself"] = hits
            unchecked = "meshes, obstacles and the moves between poses"
        lowest = _lowest_points(arm, q)
        if height is not None:
            below = f"the tip or a joint is below z = {height:g} m there"
            doubts[below] = lowest <= height
            unchecked += ", what is mounted beyond the tip"
        elif lowest.min() < 0.0:
            hints.append(
                f"the arm goes down to z = {lowest.min():.3f} m of its base frame: if a table is "
                "there, give its height with `above`"
            )
    elif height is not None:
        raise OptionError(
            "above: expected a robot that moves in space, or a model that knows its URDF",
            parameter="above",
            value=height,
        )
    body = None if isinstance(source, Arm) else source.body
    if isinstance(source, Model) and body and is_camera(body.structure.view):
        chain = Space.of(source)
        outside = ~chain.sees(chain.evaluate(q)[0])
        doubts["the tip is outside of the camera's picture there"] = outside
        unchecked += ", links that hide the tip"
    usable, dropped = usable_rows(np.ones(len(q), bool), doubts)
    notes = [
        f"{count} of {len(q)} candidates were left out because {why}"
        for why, count in dropped.items()
        if count
    ]
    last = f"{unchecked} are not checked: move slowly the first time"
    return usable, [*notes, *hints, last]


def _lowest_points(arm: SpatialArm, q: Array) -> Array:
    """Height (n,) [m] of the lowest of the tip and the joints that move."""
    motion = arm.chain.state(q)
    points = np.concatenate([motion.places, motion.position[None]])
    moving = np.ptp(points, axis=2).max(axis=1) > PLANNING.stands
    return np.asarray(points[moving, 2].min(axis=0))


def hits_itself(
    urdf: str, joint_names: Sequence[str], locked: Mapping[str, float], q: Array
) -> Mask | None:
    """Whether each posture (n, dof) brings two links of the robot together, (n,).

    Links that are joined, and those that meet in nearly all postures, are built so and not
    compared. Meshes are left out: their files are not part of a URDF.

    Returns (n,), None where no two links have collision bodies that could be compared, or where
    Pinocchio, which compares them, is not installed.
    """
    try:
        import pinocchio as pin
    except ImportError:  # it has no wheel for Windows
        return None
    text = _without_meshes(urdf)
    try:
        model: Any = pin.buildModelFromXML(text)
        bodies: Any = pin.buildGeomFromUrdfString(
            model, text, pin.GeometryType.COLLISION
        )
    except Exception:  # Pinocchio raises what its parser happened to throw
        return None

    # pairs of bodies on links that are not joined
    carriers = [body.parentJoint for body in bodies.geometryObjects]
    above = model.parents
    for (i, a), (k, b) in combinations(enumerate(carriers), 2):
        if a != b and above[a] != b and above[b] != a:
            bodies.addCollisionPair(pin.CollisionPair(i, k))

    # those that meet in each posture
    data = model.createData()
    results = pin.GeometryData(bodies)
    met = np.zeros((len(q), len(bodies.collisionPairs)), bool)
    names = [*locked, *joint_names]
    places = [model.joints[model.getJointId(name)].idx_v for name in names]
    velocity = np.zeros(model.nv)
    for row, values in zip(met, q, strict=True):
        # a joint without limits has cosine and sine as its configuration: `integrate` fills both
        velocity[places] = [*locked.values(), *values]
        posture = pin.integrate(model, pin.neutral(model), velocity)
        pin.computeCollisions(model, data, bodies, results, posture, False)
        row[:] = [result.isCollision() for result in results.collisionResults]
    compared = met[: PLANNING.compared].mean(axis=0) < PLANNING.always
    return np.asarray(met[:, compared].any(axis=1)) if compared.any() else None


def _without_meshes(urdf: str) -> str:
    """A URDF without the collision bodies that are meshes."""
    root = ET.fromstring(urdf)  # noqa: S314 - a URDF was checked when it was read
    for link in root.iter("link"):
        for body in link.findall("collision"):
            if body.find("geometry/mesh") is not None:
                link.remove(body)
    return ET.tostring(root, encoding="unicode")
