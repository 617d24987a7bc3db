"""The geometry of a planar arm that fits a model best, found as that of an arm in space.

The sensor looks straight at the arm's plane and reports two of three coordinates.  The prior holds
what it cannot see: turned joint origins, and whatever leaves the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from ..arm.arm import PlanarArm
from ..arm.rotations import logarithm, similarity
from ..body.derivative import Derivative
from ..body.fit import Fit
from ..body.parameters import Indices, Prior
from ..body.settings import FREE, SCALES, SHIFT
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array
from ..model.alignment import Alignment
from .spatial_geometry import SpatialGeometry, deviations, fit_prior, rms

#: Prior sd of a joint's offset [rad]: servos are put on to 10 deg.
_OFFSET = np.radians(10.0)
#: Nats of evidence that a wider prior of the places has to gain.
_EARNED = 5.0


class InPlane(SpatialStructure):
    """A planar arm before a sensor that looks straight at its plane."""

    @property
    def outputs(self) -> int:
        """Number of outputs: the two coordinates in the plane."""
        return 2

    @property
    def blocks(self) -> tuple[int, ...]:
        """Widths of the outputs that share a noise: both coordinates."""
        return (2,)

    @property
    def camera(self) -> bool:
        """Whether a camera sees the arm from anywhere."""
        return False

    def predict(self, q: Array, beta: Array) -> Array:
        """Outputs (n, 2) at joint values (n, dof)."""
        return super().predict(q, beta)[:, :2]

    def derivative(self, q: Array, beta: Array, active: Indices) -> tuple[Array, Derivative]:
        """Outputs (n, 2) and their derivative by the parameters `active`."""
        seen, slope = super().derivative(q, beta, active)
        return seen[:, :2], slope.rows(slice(None), slice(2))


def in_plane(arm: PlanarArm, unit: str = "m", extent: float = 1.0) -> InPlane:
    """The structure of a planar arm, its positions of an extent in a unit."""
    given = structure_of(arm, unit=unit, extent=extent)
    return InPlane(**{field.name: getattr(given, field.name) for field in fields(given)})


@dataclass(frozen=True, eq=False)
class PlanarGeometry(SpatialGeometry):
    """A fitted geometry of a planar arm, its displacements in the plane at the zero posture.

    Intervals are half widths of 95 %; what the data cannot tell apart is within them.
    """

    arm: PlanarArm

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """Displacement of each joint and of the tip (dof + 1, 2) [m], and intervals."""
        axes = np.stack([self.arm.plane.x, self.arm.plane.y])
        index = np.vstack([self.structure.shifts, self.structure.groups["tool"]])
        turned = np.stack([axes] * self.arm.dof + [axes @ self.arm.chain.rotation])
        moved = np.einsum("kij,kj->ki", turned, self.beta[index])
        return moved, 1.96 * np.sqrt(np.einsum("kij,kj->ki", turned**2, self.sd[index] ** 2))

    @property
    def frame(self) -> Alignment:
        """From coordinates in the root link's plane to what the model answers in."""
        sensor, plane = self.structure.sensor(self.beta), self.arm.plane
        turned = sensor.scale * sensor.rotation
        matrix = turned @ np.stack([plane.x, plane.y], axis=1)
        return Alignment(matrix[:2], (turned @ plane.origin + sensor.shift)[:2])

    def to_json(self) -> dict[str, Any]:
        """Plain data; intervals are half widths of 95 %."""
        (base, *moved), (width, *widths) = (part.tolist() for part in self.ends)
        ends = zip(self.arm.joint_names, moved, widths, strict=True)
        frame = {"matrix": self.frame.matrix.tolist(), "shift": self.frame.shift.tolist()}
        return {
            "offsets": self.offsets(),
            "moved": {name: {"value": end, "interval": half} for name, end, half in ends},
            "base": {"value": base, "interval": width},
            "frame": frame,
            **self.sizes(),
        }


def fit_in_plane(
    arm: PlanarArm, q: Array, x: Array, unit: str, *, free: bool, move_base: bool, error: float
) -> PlanarGeometry:
    """Fit offsets, places and, with a `free` frame, the sensor's place to positions `x` (n, 2).

    `error` [unit] is the least noise along an axis that positions are credited with: an adapted
    model answers without noise, yet with the error of its rows.
    """
    structure, scaled = in_plane(arm, unit, rms(x - x.mean(axis=0))), free and unit != "m"
    groups, beta = structure.groups, structure.neutral()
    points, seen = arm.chain.positions(q), np.c_[x, np.zeros(len(x))]
    turn, shift, scale = arm.plane.basis, -arm.plane.basis @ arm.plane.origin, 1.0
    if free:  # before a sensor that sees the plane from behind it is turned half round
        turn, shift, scale = similarity(points, seen)
        if not scaled:
            shift, scale = seen.mean(axis=0) - turn @ points.mean(axis=0), 1.0
    beta[groups["view.rotation"]] = logarithm(turn)
    beta[groups["view.shift"]], beta[groups["view.scale"]] = shift, np.log(scale)
    best: Fit | None = None
    for wider in SCALES:
        prior = _prior(structure, arm, beta, wider, free, scaled, move_base)
        fit = fit_prior(structure, q, x, beta, prior, error)
        if best is None or fit.evidence > best.evidence + _EARNED:
            best = fit
    assert best is not None  # noqa: S101
    sd = deviations(best, q)
    nominal = best.beta.copy()
    for group in ("offset", "placement", "tool"):
        nominal[groups[group]] = 0.0
    scale = structure.sensor(best.beta).scale
    residual, before = rms(best.residual) / scale, rms(x - structure.predict(q, nominal)) / scale
    reach = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    return PlanarGeometry(arm, structure, best.beta, sd, free, True, residual, before, reach)


def _prior(
    structure: InPlane,
    arm: PlanarArm,
    start: Array,
    wider: float,
    free: bool,
    scaled: bool,
    move_base: bool,
) -> Prior:
    """What may move, from a start on; the sensor turns about the plane's normal alone.

    Across a link its far end keeps the narrow width: there a displacement is the same as a turn,
    which an offset should carry.
    """
    groups, shifts, chain = structure.groups, structure.shifts, structure.chain
    ends, sd = np.vstack([shifts[1:], groups["tool"]]), np.zeros(structure.size)
    sd[groups["offset"]] = np.where(structure.revolute, _OFFSET, SHIFT * wider)
    sd[ends] = SHIFT * wider
    if free:  # the first joint's offset and a turn of the frame are one
        sd[groups["offset"][0]] = 0.0
        sd[groups["view.rotation"][2]] = 100.0
        sd[groups["view.shift"][:2]] = FREE * structure.extent
    if scaled:
        sd[groups["view.scale"]] = 100.0
    if move_base:
        sd[shifts[0]] = FREE * chain.reach
    active = np.flatnonzero(sd)
    precision = np.diag(sd[active] ** -2)
    links = np.diff(np.vstack([chain.points, chain.tip]), axis=0)
    for k, (end, turns) in enumerate(zip(ends, structure.revolute, strict=True)):
        across = np.cross(arm.plane.normal, links[k])
        length = float(np.linalg.norm(across))
        if turns and length > SHIFT:
            across = (across if k + 1 < arm.dof else across @ chain.rotation) / length
            own = np.ix_(*[np.searchsorted(active, end)] * 2)
            precision[own] += (1 - wider**-2) / SHIFT**2 * np.outer(across, across)
    return Prior(start, sd, known=precision)
