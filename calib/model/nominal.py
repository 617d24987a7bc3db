"""The nominal arm in the sensor's frame: where a controller that trusts the URDF wants the tip.

The view (the sensor's frame, scale and lens) is the body's; lengths and offsets are the
URDF's, gains are 1, elasticity and joint curves are zero.  What a correction compensates is
therefore in the arm and never in the sensor's frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import PlanarArm, SpatialArm
from ..arm.loading import arm_from_urdf
from ..arm.rotations import exponential, logarithm
from ..body.nominal import nominal_of
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from ..errors import OptionError
from ..inverse.newton import Newton
from ..inverse.pose import Joints
from ..inverse.tasks import Poses
from .parts import Parts


def nominal_in_plane(model: Parts, *, based: bool = False) -> tuple[PlanarStructure, Array]:
    """Structure and parameters (d,) of the nominal arm of a model with a planar body.

    Behind the sensor that the body knows, or, where `based`, in the robot's root frame.

    Raises OptionError if the model has no planar body, or knows no URDF.
    """
    body = model.body
    if body is None or not isinstance(body.structure, PlanarStructure):
        raise OptionError("the model has no planar body, so its sensor's frame is not known")
    nominal, about = body.structure.nominal, model.about
    if nominal is None:
        forward = nominal_arm(model).forward
        nominal = nominal_of(forward, about.lower, about.upper, about.revolute)
    structure = replace(body.structure, nominal=nominal, signs=nominal.signs)
    if based:
        structure = replace(structure, view="base", mirror=nominal.mirror)
        return structure, structure.neutral()
    beta, view = structure.neutral(), slice(structure.groups["length"][0])
    beta[view] = body.beta[view]  # the sensor's own parameters come first
    return structure, beta


def nominal_in_space(structure: SpatialStructure, beta: Array) -> Array:
    """Parameters of the drawing's arm behind the sensor, and with the tool, of a body's `beta`."""
    nominal = structure.neutral()
    for group, indices in structure.groups.items():
        if group.startswith(("view.", "tool", "lens")):
            nominal[indices] = beta[indices]
    return nominal


def moves_in_space(model: Parts) -> bool:
    """Whether the arm moves in space: seen in x, y and z, or by a camera from anywhere."""
    return len(model.axes) == 3 or (
        model.body is not None and isinstance(model.body.structure, SpatialStructure)
    )


def visited_joints(model: Parts, most: int) -> Array:
    """Joints (n, dof) of motor nodes that rows visited, at most so many, within the ranges."""
    nodes = np.flatnonzero(model.visited)
    if len(nodes) > most:
        nodes = np.sort(np.random.default_rng(0).choice(nodes, most, replace=False))
    return np.clip(model.motor.weights[nodes], model.about.lower, model.about.upper)


def nominal_arm(model: Parts) -> PlanarArm | SpatialArm:
    """Return the arm as its URDF describes it."""
    about = model.about
    if not about.urdf:
        raise OptionError(
            "the model has no URDF, so there is no nominal arm to compare it with",
            hint="train it with a robot, or with a robot and a log",
            parameter="robot",
        )
    planar = not moves_in_space(model)
    return arm_from_urdf(about.urdf, about.joint_names, about.tip, lock=about.locked, planar=planar)


@dataclass(frozen=True, eq=False)
class NominalPose:
    """Poses of the real and of the nominal arm, both in the root link's frame."""

    structure: SpatialStructure  # seen by a sensor in the root link's frame
    # (d,), parameters
    real: Array
    nominal: Array

    @staticmethod
    def of(structure: SpatialStructure, real: Array, nominal: Array) -> NominalPose | None:
        """The poses of a body; None where there are too few joints to keep an orientation."""
        if structure.dof < 6:
            return None
        root = replace(structure, view="pose", metre=1.0, unit="m")
        still = [indices for name, indices in root.groups.items() if name.startswith("view.")]
        parts = []
        for beta in (real, nominal):
            own = beta.copy()
            own[np.concatenate(still)] = 0.0
            parts.append(own)
        return NominalPose(root, *parts)

    def towards(self, q: Array) -> tuple[Array, Array]:
        """Joints (n, dof) near `q` that give the real tool the nominal pose at `q`.

        Also what is left (n,), as a share of the arm's length: a radian of turn counts as 1.
        """
        position, rotation = self.structure.pose(q, self.nominal)
        # of many steps: two or three suffice but beside singular poses
        length = max(self.structure.chain.reach, 1e-9)
        joints = Joints(q.min(axis=0) - 1.0, q.max(axis=0) + 1.0, self.structure.revolute)
        scale, target = joints.turning, Poses.target(position, rotation)
        newton = Newton(Poses(self._real, scale, length), scale, length)
        u, left = newton.refine(scale.to_unit(q), target, 1e-12)
        way = scale.difference(u, scale.to_unit(q)) * scale.span  # on q's own turn
        return q + way, left / length

    def angle(self, q: Array, corrected: Array) -> Array:
        """Angle (n,) [rad] between the nominal tool at `q` and the real one at other joints."""
        wanted = self.structure.pose(q, self.nominal)[1]
        turned = self.structure.pose(corrected, self.real)[1]
        return np.asarray(np.linalg.norm(logarithm(turned @ np.swapaxes(wanted, 1, 2)), axis=1))

    def _real(self, q: Array) -> tuple[Array, Array, Array]:
        seen, slope = self.structure.predict_and_slope(q, self.real)
        return seen[:, :3], exponential(seen[:, 3:]), slope
