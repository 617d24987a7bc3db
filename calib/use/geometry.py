"""The geometry of a chain that fits a model best: offsets, joint origins, the tip, the sensor."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..arm.arm import Arm, PlanarArm
from ..arm.description import parse_robot
from ..body.covariance import Z95
from ..body.spatial import SpatialStructure
from ..common.arrays import Array, Index
from ..common.wording import by_name
from ..model.alignment import Alignment


@dataclass(frozen=True, eq=False)
class Quantity:
    """Fitted numbers, and the half widths of their 95 % intervals."""

    value: Array
    interval: Array


MOST_UNEXPLAINED = 0.01
"""Share of the arm's reach that a geometry may leave unexplained."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """A fitted geometry of an arm."""

    arm: Arm  # the nominal arm
    structure: SpatialStructure  # its chain and view
    beta: Array  # (d,)
    covariance: Array  # (d, d), of the posterior, 0 where nothing was fitted
    frame_is_free: bool  # whether the sensor's frame was fitted, with the first joint as drawn
    # [m; px], root mean square distance that this geometry, and the nominal one, do not explain,
    # each with the sensor and the tip where they fit best
    residual: float
    nominal_residual: float
    # [m; px], furthest distance of the tip from the middle of its positions
    reach: float

    @property
    def is_explained(self) -> bool:
        """Whether it describes the model, to `MOST_UNEXPLAINED` of the reach."""
        return self.residual <= MOST_UNEXPLAINED * self.reach

    @property
    def unit(self) -> str:
        """Unit of the residuals and `reach`."""
        return self.structure.unit if self.structure.camera else "m"

    @cached_property
    def fitted_joints(self) -> tuple[str, ...]:
        """Joints whose origins are fitted, mimic joints included, as the URDF names them."""
        path = parse_robot(self.arm.urdf).path(self.arm.tip)
        return tuple(
            joint.name
            for joint in path
            if joint.movable and joint.name not in self.arm.locked
        )

    def offsets(self) -> dict[str, Quantity]:
        """Return the nominal arm's joint values when the encoders read zero [rad or m].

        A turn of a joint's origin about its axis, or a shift along the axis of a joint that
        slides, has the same effect as an offset: the sum of both is returned.
        """
        offsets = {}
        for k, name in enumerate(self.arm.joint_names):
            parts = np.zeros(self.structure.size)
            parts[self.structure.groups["offset"][k]] = 1.0
            if not isinstance(self.arm, PlanarArm):
                row = self.fitted_joints.index(name)
                along = self.structure.shifts
                if self.arm.revolute[k]:
                    along = self.structure.turns
                parts[along[row]] = self.structure.chain.axes[row]
            offsets[name] = self._quantity(parts)
        return offsets

    @property
    def link_ends(self) -> list[Quantity]:
        """Displacements in its plane of a planar arm's later joints and tip (dof) [m]."""
        assert isinstance(self.arm, PlanarArm)  # noqa: S101
        structure = self.structure
        axes = self.arm.plane.basis[:2]
        shifts = [
            self._quantity(self._parts(row, axes))
            for row in structure.shifts[1:]
        ]
        tool = self._parts(
            structure.groups["tool"], axes @ self.arm.chain.rotation
        )
        return [*shifts, self._quantity(tool)]

    @property
    def origins(self) -> list[tuple[Quantity, Quantity]]:
        """Shifts [m] and turns [rad] of a spatial arm's joint origins, then of its tip.

        The part that has the same effect as the joint's offset is left out.
        """
        structure = self.structure
        groups = structure.groups
        origins = []
        for row, axis in enumerate(structure.chain.axes):
            across = np.eye(3) - np.outer(axis, axis)
            shift = turn = np.eye(3)
            if structure.chain.revolute[row]:
                turn = across
            else:
                shift = across
            shifts = self._parts(structure.shifts[row], shift)
            turns = self._parts(structure.turns[row], turn)
            origins.append((self._quantity(shifts), self._quantity(turns)))
        shifts = self._parts(groups["tool"], np.eye(3))
        turns = self._parts(groups["tool.rotation"], np.eye(3))
        return [*origins, (self._quantity(shifts), self._quantity(turns))]

    @property
    def frame(self) -> Alignment | None:
        """From a planar arm's coordinates in its plane to what the model answers in."""
        if not isinstance(self.arm, PlanarArm):
            return None
        sensor = self.structure.sensor(self.beta)
        plane = self.arm.plane
        turned = sensor.scale * sensor.rotation
        matrix = turned @ plane.basis[:2].T
        return Alignment(matrix[:2], (turned @ plane.origin + sensor.shift)[:2])

    def document(self) -> dict[str, Any]:
        """Return what `calib urdf --json` prints; intervals are half widths of 95 %."""
        document: dict[str, Any] = {"offsets": self.offsets()}
        frame = self.frame
        if frame is None:
            *places, tip = (
                {"shift": shift, "turn": turn} for shift, turn in self.origins
            )
            document["places"] = by_name(self.fitted_joints, places)
            document["tip"] = {**tip, "written": False}
        else:
            names = self.arm.joint_names
            document["moved"] = by_name(names, self.link_ends)
            document["frame"] = frame
        return document | {
            "frame_fitted": self.frame_is_free,
            "residual": self.residual,
            "before": self.nominal_residual,
            "reach": self.reach,
        }

    def _parts(self, indices: Index, matrix: Array) -> Array:
        """Weights (k, d) of the parameters in `matrix` (k, m) times those at `indices` (m,)."""
        parts = np.zeros((len(matrix), self.structure.size))
        parts[:, indices] = matrix
        return parts

    def _quantity(self, parts: Array) -> Quantity:
        """Return the sums of parameters with weights `parts` (d,) or (k, d)."""
        variance = np.einsum("...i,ij,...j->...", parts, self.covariance, parts)
        return Quantity(
            parts @ self.beta, Z95 * np.sqrt(np.maximum(variance, 0.0))
        )
