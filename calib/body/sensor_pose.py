"""Sensor: where a fitted camera or tracker is in the arm's base frame, with intervals.

Readings of a sensor at an unknown place determine neither the base's turn about the first axis nor
its shift along it, a camera's not even the arm's size: this gauge rests on the prior alone, so
that intervals are also given without it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.rotations import exponential, logarithm, quaternion_of
from ..common.arrays import Array
from ..common.rows import row_lengths
from ..common.wording import with_interval
from .covariance import Z95
from .parameters import Gaussian, Indices
from .sensors import SENSOR_BLOCKS
from .spatial import SpatialStructure
from .structure import OfStructure, Structure

_ALIKE = 0.05
"""A motion is a gauge where parameters reproduce it up to this relative residual."""

_POSES = 60
_STEP = 1e-6  # of parameters, in derivatives


PoseOf = Callable[[SpatialStructure, Array], tuple[Array, Array]]
"""Position (3,) [m] and axes (3, 3), its columns, of something at parameters (d,)."""


def _pose_slope(
    pose_of: PoseOf, structure: SpatialStructure, beta: Array, indices: Indices
) -> Array:
    """How a pose moves with some parameters, (6, k) [m, rad], along and about its frame's axes."""
    position, axes = pose_of(structure, beta)
    slope = np.empty((6, len(indices)))
    for k, index in enumerate(indices.tolist()):
        stepped = structure.after_step(beta, index, _STEP)
        ahead, turned = pose_of(structure, stepped)
        slope[:3, k] = ahead - position
        slope[3:, k] = logarithm(turned @ axes.T)
    return slope / _STEP


def _pose_of_sensor(
    structure: SpatialStructure, beta: Array
) -> tuple[Array, Array]:
    """The sensor in the base frame."""
    sensor = structure.sensor(beta)
    back = sensor.rotation.T
    return -back @ sensor.shift / sensor.scale, back


def _pose_of_hand(
    structure: SpatialStructure, beta: Array
) -> tuple[Array, Array]:
    """What is in the hand in the tip's frame."""
    position = beta[structure.groups["tool"]]
    return position, exponential(beta[structure.groups["tool.rotation"]])


def _pose_at_encoder(
    structure: SpatialStructure, beta: Array
) -> tuple[Array, Array]:
    """Pose of the thing in the hand, with the effect of the last joint's own deviations."""
    last = _last_of_chain(structure)
    zero = np.zeros((1, structure.dof))
    (tip,), (frame,) = structure.pose(zero, structure.neutral())
    axis = structure.chain.axes[last]
    axis_in_tip = frame.T @ axis
    origin = frame.T @ (structure.chain.points[last] - tip)
    angle = axis @ beta[structure.turns[last]]
    slide = axis @ beta[structure.shifts[last]]
    offset = beta[structure.groups["offset"][-1]]
    if structure.revolute[-1]:
        angle += offset
    else:
        slide += offset
    position, axes = _pose_of_hand(structure, beta)
    back = exponential(angle * axis_in_tip)
    moved = origin + back @ (position - origin) + slide * axis_in_tip
    return moved, back @ axes


def _last_of_chain(structure: SpatialStructure) -> int:
    """Number of the last active joint among those of the chain."""
    return structure.chain_names.index(structure.joint_names[-1])


@dataclass(frozen=True, eq=False)
class SensorPose:
    """A sensor in the base frame of an arm in space; the first joint's offset is zero."""

    position: Array  # (3,) [m]
    # (3, 3), its columns are the sensor's axes; a camera's are x (right), y (down) and z (ahead)
    rotation: Array
    # (6,) [m, rad], along and about the base's axes
    sd: Array
    # the same without what no reading determines, see `without_gauge`
    sd_up_to_gauge: Array
    first: str | None = None  # the joint whose offset is zero by convention

    @staticmethod
    def of(body: OfStructure | None) -> SensorPose | None:
        """The sensor of a body in space; None in the plane, and without a drawing of the arm."""
        if body is None or not isinstance(body.structure, SpatialStructure):
            return None
        structure = body.structure
        if not structure.informed:
            return None
        beta = body.beta
        position, rotation = _pose_of_sensor(structure, beta)
        indices = sensor_of(structure)
        slope = _pose_slope(_pose_of_sensor, structure, beta, indices)
        root = body.full_root
        sd = row_lengths(slope @ root[indices])
        root[body.active] = without_gauge(structure, body, not structure.camera)
        sd_up_to_gauge = row_lengths(slope @ root[indices])
        first: str | None = None
        if structure.view != "base" and structure.revolute[0]:
            first = structure.joint_names[0]
        return SensorPose(position, rotation, sd, sd_up_to_gauge, first)

    @property
    def quaternion(self) -> Array:
        """The rotation as qx, qy, qz, qw."""
        return quaternion_of(self.rotation)

    def to_json(self) -> dict[str, Any]:
        """Position [m] and quaternion in the base frame with 95 % intervals, and the convention."""
        half = Z95 * self.sd
        low = self.position - half[:3]
        high = self.position + half[:3]
        half_up_to_gauge = Z95 * self.sd_up_to_gauge[:3]
        turn = [-np.pi, np.pi]
        about = {"joint": self.first, "offset": 0.0, "interval": turn}
        return {
            "frame": "base",
            "position": self.position.tolist(),
            "interval": np.column_stack([low, high]).tolist(),
            "quaternion": self.quaternion.tolist(),
            "turn_95": half[3:].tolist(),
            "position_95_up_to_gauge": half_up_to_gauge.tolist(),
            "convention": about if self.first else None,
        }

    def words(self, what: str) -> list[str]:
        """Lines on where it is; `what` names it."""
        halves = 1e3 * Z95 * self.sd[:3]
        coordinates = map(with_interval, 1e3 * self.position, halves)
        quaternion = ", ".join(f"{v:.5f}" for v in self.quaternion)
        lines = [
            f"{what} at ({', '.join(coordinates)}) mm in the base frame, turned within "
            f"{np.degrees(Z95 * self.sd[3:].max()):.2g} deg, quaternion ({quaternion})"
        ]
        if self.first:
            lines.append(
                f"  its turn about {self.first} cannot be told from that joint's offset, which is "
                "zero by convention"
            )
        return lines


def hand_pose(body: OfStructure) -> SensorPose:
    """Where the thing in the hand is in the tip's frame, by a belief of its poses.

    The last joint counts as its encoder reads: a thing in the hand turned about that joint's axis,
    and the joint's offset the other way, give the same pictures; so does a shift along it.  The
    intervals up to gauge leave that out; the others are those of a joint with its own offset.
    """
    structure = body.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - poses are in space
    beta = body.beta
    root = body.full_root
    groups = structure.groups
    of_tool = np.append(groups["tool"], groups["tool.rotation"])
    slope = _pose_slope(_pose_of_hand, structure, beta, of_tool)
    sd = row_lengths(slope @ root[of_tool])
    last = structure.placements[_last_of_chain(structure)].ravel()
    of_last = np.concatenate([of_tool, last, groups["offset"][-1:]])
    slope = _pose_slope(_pose_at_encoder, structure, beta, of_last)
    sd_up_to_gauge = row_lengths(slope @ root[of_last])
    position, axes = _pose_at_encoder(structure, beta)
    return SensorPose(position, axes, sd, sd_up_to_gauge)


def without_gauge(
    structure: SpatialStructure, belief: Gaussian, size: bool
) -> Array:
    """Root (k, r) of a belief's covariance without motions of the tip that no reading determines.

    Among parameters that readings cannot distinguish, those nearest to the belief are taken:
    a change of datum (Baarda 1981, S-transformation). Without `size` an error of all lengths by
    one factor is left out too.
    """
    base, beta = without_sensor(structure, belief.beta)
    of_arm = ~np.isin(belief.active, sensor_of(structure))
    rng = np.random.default_rng(0)
    q = rng.uniform(-2.0, 2.0, (_POSES, base.dof))
    position, slope = base.linearise(q, beta, belief.active[of_arm])
    axis = base.chain.axes[0]
    arm = position - base.chain.points[0]
    turn = np.cross(axis, arm)
    shift = np.broadcast_to(axis, arm.shape)
    motions = [turn, shift]
    if not size:
        motions.append(arm)
    count = len(motions)
    targets = np.reshape(motions, (count, -1)).T
    # derivatives by independent standard normals
    flat = slope.reshape(len(targets), -1)
    columns = flat @ belief.root[of_arm]
    combinations, *_ = np.linalg.lstsq(columns, targets, rcond=1e-9)
    misfit = columns @ combinations - targets
    sizes = np.linalg.norm(targets, axis=0)
    is_gauge = np.linalg.norm(misfit, axis=0) < _ALIKE * sizes
    combinations, _ = np.linalg.qr(combinations[:, is_gauge])
    gauge = (belief.root @ combinations) @ combinations.T
    root: Array = belief.root - gauge
    return root


def sensor_of(structure: Structure) -> Indices:
    """Indices of the sensor's parameters."""
    return np.concatenate([structure.groups[name] for name in SENSOR_BLOCKS])


def without_sensor(
    structure: SpatialStructure, beta: Array
) -> tuple[SpatialStructure, Array]:
    """The arm alone: its structure in the base frame [m], and parameters (d,)."""
    base = structure.with_sensor(
        view="base", unit="m", metre=1.0, extent=structure.chain.reach
    )
    arm = beta.copy()
    sensor = sensor_of(structure)
    arm[sensor] = structure.neutral()[sensor]
    return base, arm
