"""Space: what the chain of an arm in space answers, in its base frame: poses, pixels on a plane.

Positions in the sensor's frame are answered by the model itself, see `calib.Model.solve`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..arm.arm import SpatialArm
from ..arm.loading import arm_from_urdf
from ..arm.rotations import quaternion_of
from ..body.belief import Body, Second
from ..body.sensor_pose import sensor_of, without_gauge, without_sensor
from ..body.spatial import SpatialStructure, structure_of
from ..body.views import is_camera, pixels
from ..common.arrays import Array, Mask
from ..common.rows import checked_rows
from ..common.scale import Scale
from ..errors import QueryError
from ..inverse.closed_form import WAYS, ClosedForm
from ..inverse.families import free_directions
from ..inverse.newton import Newton
from ..inverse.postures import DrawnPostures, Postures
from ..inverse.search import Search, Starts
from ..inverse.settings import SEARCH
from ..inverse.task import Poses, Positions, Task
from ..inverse.ways import rank_within
from ..kernel.compiled import CERTAIN
from .parts import Parts

#: A pose or a position counts as reached within this share of the arm's length.
REACHED = 1e-6
_LENS = 30  # iterations of a lens turned round
_FAMILIES = 4  # ways of redundant joints to a pose that are answered

_Belief = TypeVar("_Belief", Body, Second)


@dataclass(frozen=True, eq=False)
class Space:
    """The arm of a model in its base frame."""

    model: Parts
    body: Body  # the body in the view "base", in m
    length: float  # [m], the arm's length

    @staticmethod
    def of(model: Parts) -> Space:
        """The arm of a model, made once; QueryError if the model knows no chain in space."""
        if "space" not in model.remembered:
            body = _in_base(model.body) or _drawn(model)
            if body is None:
                raise QueryError(
                    "the model knows no arm in space in its base frame: expected one that was "
                    "learned from a log together with the robot that it is of"
                )
            structure: Any = body.structure
            length = max(structure.chain.reach, 1e-9)
            model.remembered["space"] = Space(model, body, length)
        space: Space = model.remembered["space"]
        return space

    # What the chain says.

    def evaluate(
        self, q: Array, *, bending: bool = False
    ) -> tuple[Array, Array, Array]:
        """Position (n, 3) [m], orientation (n, 3, 3) and Jacobian (n, 6, dof) of the tip.

        How bending changes with the joints is a thousandth of the Jacobian and half of its time:
        steps to a target do without.
        """
        structure = self.body.structure
        beta = self.body.beta
        motion: Any = structure.move(structure.joint_values(q, beta), beta)
        chained = np.concatenate(motion.joints(), axis=1)
        slope = structure.by_joints(
            q, beta if bending else self._rigid, chained
        )
        return (
            motion.position.T.copy(),
            np.moveaxis(motion.rotation, 2, 0).copy(),
            slope,
        )

    @cached_property
    def _rigid(self) -> Array:
        """The body's parameters (d,) without what bends its joints."""
        structure = self.body.structure
        beta = self.body.beta.copy()
        for block in structure.loads:
            beta[structure.groups[block]] = 0.0
        return beta

    def forward(self, q: ArrayLike) -> tuple[Array, Array]:
        """Position (n, 3) [m] and quaternion (n, 4) of the tip; NaN where the model has none."""
        rows, _ = checked_rows(q, self.model.about.joint_names, "joint values")
        position, rotation, _ = self.evaluate(rows)
        lost = ~self.model.covers(rows)
        turn = quaternion_of(rotation)
        position[lost] = np.nan
        turn[lost] = np.nan
        return position, turn

    def bound(self, q: ArrayLike, *, size: bool = True) -> Array:
        """95 % bound (n,) in the base frame [m], which stands where the belief has it.

        Its turn about and its shift along the first joint's axis are a convention.  A camera cannot
        tell the arm's size either: without `size` that is left out too.
        """
        body = (
            self.body
            if size
            else _in_base(self.model.body, size=False) or self.body
        )
        return body.bound(
            np.atleast_2d(np.asarray(q, dtype=float)), noise=False
        )

    def free(self, q: Array, *, posed: bool, axis: int | None = None) -> Array:
        """Directions (k, dof) that leave the position, or the pose, of joints (dof,) as it is.

        Of a pose the turn about an axis of the tip may be left open.
        """
        _, rotation, jacobian = self.evaluate(q[None], bending=True)
        moves = jacobian[0, :3] / self.length
        if not posed:
            return free_directions(moves)
        turns = jacobian[0, 3:]
        if axis is not None:
            turns = np.delete(rotation[0].T @ turns, axis, axis=0)
        return free_directions(np.concatenate([moves, turns]))

    # What its sensor sees.

    @property
    def measured(self) -> bool:
        """Whether its body was learned from a log, rather than drawn."""
        structure: Any = (
            None if self.model.body is None else self.model.body.structure
        )
        return structure is not None and getattr(structure, "informed", False)

    @property
    def camera(self) -> bool:
        """Whether the sensor is a camera, so that its readings are pixels."""
        return self.model.body is not None and is_camera(
            self.model.body.structure.view
        )

    @property
    def sensor(self) -> tuple[Array, Array, float]:
        """Rotation, shift and scale of the sensor: it sees ``scale rotation point + shift``."""
        body: Any = self.model.body
        if (
            body is None
            or not isinstance(body.structure, SpatialStructure)
            or not body.structure.informed
        ):
            return (
                np.eye(3),
                np.zeros(3),
                1.0,
            )  # a simulated sensor is in the base frame
        placed = body.structure.sensor(body.beta)
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
        rows, _ = checked_rows(pixel, ("x", "y"), "pixels")
        if not self.camera:
            raise QueryError(
                "a pixel on a plane needs a model that was learned from pixels u, v"
            )
        turn, shift, _ = self.sensor
        body: Any = self.model.body
        ideal = _undistorted(rows, body.beta[body.structure.groups["lens"]])
        rays = np.column_stack([ideal, np.ones(len(ideal))]) @ turn
        eye = -turn.T @ shift
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (height - eye[2]) / rays[:, 2]
        missed = ~((depth > 0) & np.isfinite(depth))
        if missed.any():
            raise QueryError(
                f"pixel {rows[missed][0].round(1).tolist()} shows no point of the plane "
                f"z = {height:g} m in front of the camera: its line of sight runs along the plane "
                "or away from it"
            )
        return np.asarray(eye + depth[:, None] * rays)

    def sees(self, position: ArrayLike) -> Mask:
        """Whether a camera's picture shows points (n, 3) of the base frame, (n,)."""
        body: Any = self.model.body
        points = np.atleast_2d(np.asarray(position, dtype=float))
        if not self.camera:
            return np.ones(len(points), dtype=bool)
        sensor = body.structure.sensor(body.beta)
        place = points @ sensor.rotation.T + sensor.shift
        ahead = place[:, 2] > 0
        view = pixels(sensor.lens, place.T)
        size = self.model.about.picture or tuple(2 * sensor.lens[1:3])
        inside = ((view.values >= 0) & (view.values <= size)).all(axis=1)
        # where the lens folds over, the picture shrinks as the point moves outwards
        out = view.point * np.array([[1.0], [1.0], [0.0]])
        return np.asarray(
            ahead & inside & ((view.seen(out) * out[:2]).sum(axis=0) >= 0)
        )

    # Joints for places and poses.

    def beside(
        self, p: Array, r: Array | None, near: Array
    ) -> tuple[Array, Array]:
        """Joints (n, dof) beside `near` for places (n, 3), or poses with `r`, and what is missing.

        Of a pose a radian of turn counts as the arm's length.
        """
        search = self.search(posed=r is not None)
        target = p if r is None else Poses.target(p, r)
        stand = search.newton.refine(self._unit(near), target)
        return self._scale.from_unit(stand.u), stand.miss

    def at_positions(
        self, p: Array, near: Array, *, keep: bool = False
    ) -> Array:
        """Joints (n, dof) nearest to `near` (n, dof) for positions (n, 3) of the base frame [m].

        Out of reach those whose tip comes nearest.  `keep` holds the orientation that the tip has
        at `near` as far as the joints allow.
        """
        search = self.search(posed=False)
        wish = self._unit(near)
        if keep:
            wish = self._turned_least(p, wish)
        return self._scale.from_unit(search.nearest(p, wish).u)

    def _turned_least(self, p: Array, u: Array) -> Array:
        """Joints for positions (n, 3), turned as little as possible from where joints `u` are."""
        # positions weigh a thousand times as much as the turn
        task = Poses(
            self.evaluate, self._scale, 1e-3 * self.length, self.length
        )
        target = Poses.target(p, self.evaluate(self._scale.from_unit(u))[1])
        newton = Newton(task, self._scale)
        return newton.refine(u, target, steps=4 * SEARCH.steps).u

    def at_poses(
        self, p: Array, r: Array, near: Array, free: int | None = None
    ) -> Array:
        """Joints (n, dof) nearest to `near` (n, dof) for poses (n, 3), (n, 3, 3) of the base frame.

        Where none reaches a pose, those that come nearest.  A turn about an axis of the tip, `free`
        0 to 2, may be left open.
        """
        search = self.search(posed=True, free=free)
        target = Poses.target(p, r)
        q = near.copy()
        rest = np.arange(len(p))
        kernel = self.model.kernel
        if kernel is not None and kernel.poses:
            asked = self._asked(p, r, free)
            q, sure = kernel.rows(
                "poses", near, *asked, np.full((len(p), 1), -1)
            )
            rows = np.flatnonzero(sure != CERTAIN)
            if len(rows):
                some = [column[rows] for column in asked]
                starts = self._kernel_starts(search, target[rows])
                q[rows], sure[rows] = kernel.rows(
                    "poses", near[rows], *some, *starts
                )
            rest = np.flatnonzero(sure == 0)
        if len(rest):
            u = search.nearest(target[rest], self._unit(near[rest])).u
            q[rest] = self._scale.from_unit(u)
        return q

    def branches(
        self, p: Array, r: Array, near: Array, free: int | None = None
    ) -> list[Array]:
        """Joints (k, dof) of every way to poses (n, 3), (n, 3, 3) of the base frame, nearest first.

        Where none reaches a pose, those that come nearest; of the infinitely many of redundant
        joints some that are near to `near` (n, dof).
        """
        search = self.search(posed=True, free=free)
        target = Poses.target(p, r)
        newton = search.newton
        kernel = self.model.kernel
        if kernel is not None and kernel.poses and not newton.redundant:
            asked = self._asked(p, r, free)
            starts = self._kernel_starts(search, target)
            q, count = kernel.rows("poses_all", near, *asked, *starts)
            ways = [rows[:k] for rows, k in zip(q, count.tolist(), strict=True)]
        else:
            owner, u, _ = search.every(target)
            edges = np.searchsorted(owner, np.arange(1, len(p)))
            ways = np.split(self._scale.from_unit(u), edges)
        answers: list[Array] = []
        for rows, goal, wish in zip(
            ways, target, self._unit(near), strict=True
        ):
            if not len(rows):
                stand = search.nearest(goal[None], wish[None])
                answers.append(self._scale.from_unit(stand.u))
                continue
            u = self._scale.to_unit(rows)
            u = u[np.argsort(newton.away(u, wish), kind="stable")]
            if newton.redundant:
                u = u[:_FAMILIES]
                goals = np.tile(goal, (len(u), 1))
                wishes = np.tile(wish, (len(u), 1))
                stand = newton.settle(u, goals, wishes)
                u = np.where(newton.met(stand.miss)[:, None], stand.u, u)
            answers.append(self._scale.from_unit(u))
        return answers

    def search(self, *, posed: bool, free: int | None = None) -> Search:
        """The search for places (n, 3), or for poses (n, 12) of the base frame."""
        key = posed, free
        if key not in self._searches:
            task: Task = Positions.in_base(
                self.evaluate, self._scale, self.length
            )
            if posed:
                task = Poses(
                    self.evaluate, self._scale, self.length, self.length, free
                )
            starts = self._starts(posed=posed, free=free)
            newton = Newton(task, self._scale)
            self._searches[key] = Search(newton, starts, SEARCH.surely)
        return self._searches[key]

    @cached_property
    def _searches(self) -> dict[tuple[bool, int | None], Search]:
        return {}

    def _starts(self, *, posed: bool, free: int | None) -> Starts:
        """Starts of the drawing's closed form where that answers, else a table's."""
        structure: Any = self.body.structure
        closed = ClosedForm.of(structure.chain)
        if posed and free is None and closed is not None:
            gain = self.body.beta[structure.groups["gain"]]
            offset = self.body.beta[structure.groups["offset"]]
            return DrawnPostures(closed, self._scale, gain, offset)
        columns: tuple[int, ...] = (0, 1, 2)
        if posed and free is None:
            columns = tuple(range(12))
        elif free is not None:
            columns = (0, 1, 2, *range(3 + free, 12, 3))
        return Postures(self.evaluate, self._scale, self.length, columns)

    def _asked(
        self, p: Array, r: Array, free: int | None
    ) -> tuple[Array, Array, Array]:
        """What the compiled C is asked of poses: places, quaternions, the free axis or -1."""
        place, turn = self.to_sensor(p, r)
        axis = -1 if free is None else free
        return place, quaternion_of(turn), np.full((len(p), 1), axis)

    def _kernel_starts(
        self, search: Search, target: Array
    ) -> tuple[Array, Array]:
        """How many starts poses have by the drawing's closed form, and these; none is NaN."""
        if not isinstance(search.starts, DrawnPostures):
            return np.zeros((len(target), 1)), np.zeros((len(target), 0))
        owner, u = search.starts.of(target)
        starts = np.full((len(target), WAYS, u.shape[1]), np.nan)
        starts[owner, rank_within(owner)] = self._scale.from_unit(u)
        count = np.full((len(target), 1), WAYS)
        return count, starts.reshape(len(target), -1)

    def _unit(self, q: Array) -> Array:
        return self.search(posed=False).newton.clip(self._scale.to_unit(q))

    @property
    def _scale(self) -> Scale:
        return self.model.motor.scale


def _undistorted(pixel: Array, lens: Array) -> Array:
    """Directions (n, 2) as x/z, y/z of pixels (n, 2) through a lens (f, u0, v0, k1)."""
    f, u0, v0, k1 = lens
    bent = (pixel - (u0, v0)) / f
    radius = np.linalg.norm(bent, axis=1)
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


def _in_base(body: Body | None, *, size: bool = True) -> Body | None:
    """A drawn body without its sensor, its outputs the tip in the base frame [m], by convention."""
    structure: Any = None if body is None else body.structure
    if (
        body is None
        or not isinstance(structure, SpatialStructure)
        or not structure.informed
    ):
        return None

    def alone(belief: _Belief) -> _Belief:
        # a base frame behind a sensor is turned about the first axis as the belief has it
        free = structure.view != "base"
        root = without_gauge(structure, belief, size) if free else belief.root
        arm = ~np.isin(belief.active, sensor_of(structure))
        beta = without_sensor(structure, belief.beta)[1]
        active = belief.active[arm]
        return replace(
            belief, beta=beta, active=active, root=root[arm], noise=np.zeros(3)
        )

    base = without_sensor(structure, body.beta)[0]
    none = np.zeros(3)
    second = body.second and alone(body.second)
    return replace(
        alone(body), structure=base, tau=none, residual=none, second=second
    )


def _drawn(model: Parts) -> Body | None:
    """The drawn arm of a simulation whose arm and sensor were not changed."""
    about = model.about
    if (
        about.source != "simulation"
        or not about.urdf
        or (about.simulation or {}).get("changes")
    ):
        return None
    arm = arm_from_urdf(
        about.urdf, about.joint_names, about.tip, lock=about.locked
    )
    if not isinstance(arm, SpatialArm):
        return None
    structure = structure_of(arm, "base")
    none = np.zeros(3)
    active = structure.groups["tool"]
    root = np.zeros((3, 3))
    return Body(
        structure,
        structure.neutral(),
        active,
        root,
        none,
        1.0,
        none,
        none,
        np.inf,
        1.0,
        simulated=True,
    )
