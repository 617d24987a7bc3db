"""Space: poses of an arm in space in its base frame, and pixels on a plane there.

Positions in the sensor's frame are answered by the model itself, see `calib.Model.solve`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..arm.arm import SpatialArm
from ..arm.rotations import quaternion_of
from ..body.belief import Body, GuardFit
from ..body.sensor_pose import sensor_of, without_gauge, without_sensor
from ..body.spatial import SpatialStructure, structure_of
from ..body.views import is_camera, pixels
from ..common.arrays import Array, Mask
from ..common.inputs import query_rows
from ..common.rows import row_lengths
from ..errors import QueryError
from .parts import ModelParts, remembered

if TYPE_CHECKING:
    from ..kernel.arm import Sag

#: A pose or a position counts as reached within this share of the arm's length.
REACHED = 1e-6
_LENS = 30  # iterations that invert a lens

_Belief = TypeVar("_Belief", Body, GuardFit)


@dataclass(frozen=True, eq=False)
class Space:
    """The arm of a model in its base frame."""

    model: ModelParts
    body: Body  # the body in the view "base", in m

    @staticmethod
    def of(model: ModelParts) -> Space:
        """The arm of a model, made once; QueryError if the model knows no chain in space."""
        return remembered(model, "space", lambda: _space_of(model))

    @property
    def structure(self) -> SpatialStructure:
        """The chain, seen from its base."""
        structure = self.body.structure
        assert isinstance(structure, SpatialStructure)  # noqa: S101
        return structure

    @cached_property
    def length(self) -> float:
        """The arm's length [m]."""
        return max(self.structure.chain.reach, 1e-9)

    # What follows from the chain.

    def evaluate(self, q: Array) -> tuple[Array, Array, Array]:
        """Position (n, 3) [m], orientation (n, 3, 3) and Jacobian (n, 6, dof) of the tip.

        The Jacobian is that of joints that do not bend: how bending changes with them is a
        thousandth of it, and would take half of the time of a step to a target.
        """
        structure = self.structure
        beta = self.body.beta
        values = structure.joint_values(q, self._rigid)
        if self._sag is not None:
            values += self._sag.bends(q)
        motion = structure.move(values, beta)
        chained = np.concatenate(motion.joints(), axis=1)
        return (
            motion.position.T.copy(),
            motion.rotation.transpose(2, 0, 1).copy(),
            structure.by_joints(q, self._rigid, chained),
        )

    @cached_property
    def _sag(self) -> Sag | None:
        """How its joints bend."""
        from ..kernel.arm import Sag

        return Sag.of(self.structure, self.body.beta)

    @cached_property
    def _rigid(self) -> Array:
        """The body's parameters (d,) without what bends its joints."""
        beta = self.body.beta.copy()
        for block in self.structure.loads:
            beta[self.structure.groups[block]] = 0.0
        return beta

    def forward(self, q: ArrayLike) -> tuple[Array, Array]:
        """Position (n, 3) [m] and quaternion (n, 4) of the tip; NaN where the model has none."""
        rows, _ = query_rows(q, self.model.about.joint_names, "joint values")
        position, rotation, _ = self.evaluate(rows)
        lost = ~self.model.covers(rows)
        turn = quaternion_of(rotation)
        position[lost] = np.nan
        turn[lost] = np.nan
        return position, turn

    def bound(self, q: Array) -> Array:
        """95 % bound (n,) at joints (n, dof) in the base frame [m], where the belief has it.

        Its turn about and its shift along the first joint's axis are a convention.
        """
        return self.body.bound(q, noise=False)

    # What its sensor sees.

    @property
    def camera(self) -> bool:
        """Whether the sensor is a camera, so that its readings are pixels."""
        return self.model.body is not None and is_camera(
            self.model.body.structure.view
        )

    @property
    def sensor(self) -> tuple[Array, Array, float]:
        """Rotation, shift and scale of the sensor: it sees ``scale rotation point + shift``."""
        body = self.model.body
        structure = measured_chain(body)
        if body is None or structure is None:
            # a simulated sensor is in the base frame
            return np.eye(3), np.zeros(3), 1.0
        placed = structure.sensor(body.beta)
        return placed.rotation, placed.shift, placed.scale

    def to_sensor(
        self, position: Array, rotation: Array
    ) -> tuple[Array, Array]:
        """Positions (n, 3) [unit] and orientations (n, 3, 3) in the sensor's frame."""
        turn, shift, scale = self.sensor
        return scale * position @ turn.T + shift, turn @ rotation

    def to_base(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Positions (n, 3) [m] and orientations (n, 3, 3) in the base frame."""
        turn, shift, scale = self.sensor
        return (position - shift) @ turn / scale, turn.T @ rotation

    def pixels_on_plane(self, pixel: ArrayLike, height: float) -> Array:
        """Points (n, 3) [m] of the base frame's plane z = height that pixels (n, 2) show.

        Raises QueryError if the model is of no camera, or a line of sight misses the plane.
        """
        rows, _ = query_rows(pixel, ("x", "y"), "pixels")
        body = self.model.body
        if body is None or not self.camera:
            raise QueryError(
                "a pixel on a plane needs a model that was learned from pixels u, v"
            )
        turn, shift, _ = self.sensor
        ideal = _directions_of(rows, body.beta[body.structure.groups["lens"]])
        rays = np.column_stack([ideal, np.ones(len(ideal))]) @ turn
        eye = -turn.T @ shift
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (height - eye[2]) / rays[:, 2]
        beside = ~((depth > 0) & np.isfinite(depth))
        if beside.any():
            raise QueryError(
                f"pixel {rows[beside][0].round(1).tolist()} shows no point of the plane "
                f"z = {height:g} m in front of the camera: its line of sight runs along the plane "
                "or away from it"
            )
        return np.asarray(eye + depth[:, None] * rays)

    def sees(self, position: ArrayLike) -> Mask:
        """Whether a camera's picture shows points (n, 3) of the base frame, (n,)."""
        body = self.model.body
        points = np.atleast_2d(np.asarray(position, dtype=float))
        if body is None or not self.camera:
            return np.ones(len(points), dtype=bool)
        turn, shift, _ = self.sensor
        lens = body.beta[body.structure.groups["lens"]]
        place = points @ turn.T + shift
        ahead = place[:, 2] > 0
        seen = pixels(lens, place.T, np.eye(3)).values
        size = self.model.about.picture or tuple(2 * lens[1:3])
        inside = ((seen >= 0) & (seen <= size)).all(axis=1)
        # where the lens folds over, the picture shrinks as the point moves outwards
        bend = 3.0 * lens[3] * (place[:, :2] ** 2).sum(axis=1)
        unfolded = place[:, 2] ** 2 + bend >= 0
        return np.asarray(ahead & inside & unfolded)


def _space_of(model: ModelParts) -> Space:
    body = _in_base(model.body) or _drawn_body(model)
    if body is None:
        raise QueryError(
            "the model knows no arm in space in its base frame: expected one of an arm that moves "
            "in space, learned together with its robot"
        )
    return Space(model, body)


def measured_chain(body: Body | None) -> SpatialStructure | None:
    """The chain in space of a body that was learned from a log together with its drawing."""
    if body is None or not isinstance(body.structure, SpatialStructure):
        return None
    return body.structure if body.structure.informed else None


def _directions_of(pixel: Array, lens: Array) -> Array:
    """Directions (n, 2), x/z and y/z, that a lens (f, u0, v0, k1) shows at pixels (n, 2)."""
    f, u0, v0, k1 = lens
    bent = (pixel - (u0, v0)) / f
    radius = row_lengths(bent)
    r = radius
    for _ in range(_LENS):  # Newton's rule, not beyond the lens's fold
        slope = np.maximum(1 + 3 * k1 * r * r, 1e-6)
        r = r - (r * (1 + k1 * r * r) - radius) / slope
    beyond = ~(np.abs(r * (1 + k1 * r * r) - radius) <= 1e-9)
    if beyond.any():
        raise QueryError(
            f"pixel {pixel[beyond][0].round(1).tolist()} lies beyond what a lens of k1 {k1:.3g} "
            f"can show: expected one nearer to ({u0:.0f}, {v0:.0f})"
        )
    return np.asarray(bent * (r / np.where(radius > 0, radius, 1.0))[:, None])


def _in_base(body: Body | None) -> Body | None:
    """A drawn body without its sensor, its outputs the tip in the base frame [m], by convention."""
    structure = measured_chain(body)
    if body is None or structure is None:
        return None
    zeros = np.zeros(3)
    second = body.second and _of_the_arm(structure, body.second)
    return replace(
        _of_the_arm(structure, body),
        structure=without_sensor(structure, body.beta)[0],
        noise=zeros,
        tau=zeros,
        residual=zeros,
        second=second,
    )


def _of_the_arm(structure: SpatialStructure, belief: _Belief) -> _Belief:
    """The belief on the arm alone, without its sensor."""
    root = belief.root
    if structure.view != "base":
        # a base frame behind a sensor is turned about the first axis as the belief has it
        root = without_gauge(structure, belief, size=True)
    arm = ~np.isin(belief.active, sensor_of(structure))
    return replace(
        belief,
        beta=without_sensor(structure, belief.beta)[1],
        active=belief.active[arm],
        root=root[arm],
    )


def _drawn_body(model: ModelParts) -> Body | None:
    """The drawn arm of a simulation whose arm and sensor were not changed."""
    about = model.about
    if (
        about.source != "simulation"
        or not about.urdf
        or (about.simulation or {}).get("changes")
    ):
        return None
    from ..arm.loading import arm_from_urdf

    arm = arm_from_urdf(
        about.urdf, about.joint_names, about.tip, lock=about.locked
    )
    if not isinstance(arm, SpatialArm):
        return None
    structure = structure_of(arm, "base")
    zeros = np.zeros(3)
    return Body(
        structure=structure,
        beta=structure.neutral(),
        active=structure.groups["tool"],
        root=np.zeros((3, 3)),
        noise=zeros,
        kappa=1.0,
        tau=zeros,
        residual=zeros,
        simulated=True,
    )
