"""Space: what the chain of an arm in space answers, in its base frame: poses, pixels on a plane.

Positions in the sensor's frame are answered by the model itself, see `calib.Model.solve`.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arm.arm import SpatialArm
from ..arm.loading import arm_from_urdf
from ..arm.rotations import quaternion_of
from ..body.belief import Body, Second
from ..body.sensor_pose import sensor_of, without_gauge, without_sensor
from ..body.spatial import structure_of
from ..body.views import is_camera, pixels
from ..common.arrays import Array
from ..common.rows import checked_rows
from ..common.scale import Scale
from ..errors import QueryError
from ..inverse.closed_form import ClosedForm
from ..inverse.newton import Newton
from ..inverse.pose import TOLERANCE, Joints, refined_ways, searched_ways
from ..inverse.settings import SEARCH
from ..inverse.solver import free_directions
from ..inverse.starts import drawn, twins
from ..inverse.task import Poses, Positions
from .parts import Parts

_STEPS = 40  # of a search whose residual stays
#: A pose or a position counts as reached within this share of the arm's length.
REACHED = 1e-6
_STARTS = 64  # joints from which what was missed is tried again
_LENS = 30  # iterations of a lens turned round
_FAMILIES = 4  # ways of redundant joints to a pose that are told
_ASIDE = 0.1  # [rad] by which the drawing's joints may lie beyond the limits

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
        found: Space = model.remembered["space"]
        return found

    # What the chain says.

    def evaluate(self, q: Array) -> tuple[Array, Array, Array]:
        """Position (n, 3) [m], orientation (n, 3, 3) and Jacobian (n, 6, dof) of the tip."""
        structure = self.body.structure
        beta = self.body.beta
        motion: Any = structure.move(structure.joint_values(q, beta), beta)
        slope = structure.by_joints(q, beta, np.concatenate(motion.joints(), axis=1))
        return (
            motion.position.T.copy(),
            np.moveaxis(motion.rotation, 2, 0).copy(),
            slope,
        )

    def forward(self, q: ArrayLike) -> tuple[Array, Array]:
        """Position (n, 3) [m] and quaternion (n, 4) of the tip; NaN where the model has none."""
        rows, _ = checked_rows(q, self.model.about.joint_names, "joint values")
        position, rotation, _ = self.evaluate(rows)
        known = self.model.covers(rows)[:, None]
        return np.where(known, position, np.nan), np.where(
            known, quaternion_of(rotation), np.nan
        )

    def bound(self, q: ArrayLike, *, size: bool = True) -> Array:
        """95 % bound (n,) in the base frame [m], which stands where the belief has it.

        Its turn about and its shift along the first joint's axis are a convention.  A camera cannot
        tell the arm's size either: without `size` that is left out too.
        """
        body = self.body if size else _in_base(self.model.body, size=False) or self.body
        return body.bound(np.atleast_2d(np.asarray(q, dtype=float)), noise=False)

    def free(self, q: Array, *, posed: bool, axis: int | None = None) -> Array:
        """Directions (k, dof) that leave the position, or the pose, of joints (dof,) as it is.

        Of a pose the turn about an axis of the tip may be left open.
        """
        _, rotation, jacobian = self.evaluate(q[None])
        moves = jacobian[0, :3] / self.length
        if not posed:
            return free_directions(moves)
        turns = jacobian[0, 3:]
        if axis is not None:
            turns = np.delete(rotation[0].T @ turns, axis, axis=0)
        return free_directions(np.concatenate([moves, turns]))

    # What its sensor sees.

    @property
    def camera(self) -> bool:
        """Whether the sensor is a camera, so that its readings are pixels."""
        return self.model.body is not None and is_camera(self.model.body.structure.view)

    @property
    def sensor(self) -> tuple[Array, Array, float]:
        """Rotation, shift and scale of the sensor: it sees ``scale rotation point + shift``."""
        own: Any = self.model.body
        if own is None or own.structure.kind != "spatial" or not own.structure.informed:
            return (
                np.eye(3),
                np.zeros(3),
                1.0,
            )  # a simulated sensor is in the base frame
        placed = own.structure.sensor(own.beta)
        return placed.rotation, placed.shift, placed.scale

    def to_sensor(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Positions (n, 3) [unit] and orientations (n, 3, 3) in the sensor's frame."""
        turn, shift, scale = self.sensor
        return scale * position @ turn.T + shift, turn @ rotation

    def to_base(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Positions (n, 3) [m] and orientations (n, 3, 3) in the base frame."""
        turn, shift, scale = self.sensor
        return (position - shift) @ turn / scale, turn.T @ rotation

    def pixels_on_plane(self, seen: ArrayLike, height: float) -> Array:
        """Points (n, 3) [m] of the base frame's plane z = height that pixels `seen` (n, 2) show.

        Raises QueryError if the model is of no camera, or a line of sight misses the plane.
        """
        rows, _ = checked_rows(seen, ("x", "y"), "pixels")
        if not self.camera:
            raise QueryError(
                "a pixel on a plane needs a model that was learned from pixels u, v"
            )
        turn, shift, _ = self.sensor
        own: Any = self.model.body
        ideal = _undistorted(rows, own.beta[own.structure.groups["lens"]])
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

    def sees(self, position: ArrayLike) -> NDArray[np.bool_]:
        """Whether a camera's picture shows points (n, 3) of the base frame, (n,)."""
        own: Any = self.model.body
        points = np.atleast_2d(np.asarray(position, dtype=float))
        if not self.camera:
            return np.ones(len(points), dtype=bool)
        sensor = own.structure.sensor(own.beta)
        seen = points @ sensor.rotation.T + sensor.shift
        ahead = seen[:, 2] > 0
        view = pixels(sensor.lens, seen.T)
        size = self.model.about.picture or tuple(2 * sensor.lens[1:3])
        inside = ((view.values >= 0) & (view.values <= size)).all(axis=1)
        # where the lens folds over, the picture shrinks as the point moves outwards
        out = view.point * np.array([[1.0], [1.0], [0.0]])
        return np.asarray(
            ahead & inside & ((view.seen(out) * out[:2]).sum(axis=0) >= 0)
        )

    # Joints for places and poses.

    def beside(self, p: Array, r: Array | None, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) beside `near` for places (n, 3), or poses with `r`, and what is left."""
        newton, target = (
            (self._placing, p) if r is None else (self._posing, Poses.target(p, r))
        )
        u, left = newton.refine(self._unit(near), target, 1e-3 * TOLERANCE)
        return self._scale.from_unit(u), left

    def at_positions(self, p: Array, near: Array, *, keep: bool = False) -> Array:
        """Joints (n, dof) nearest to `near` (n, dof) for positions (n, 3) of the base frame [m].

        Out of reach those whose tip comes nearest.  `keep` holds the orientation that the tip has
        at `near` as far as the joints allow.
        """
        newton = self._placing
        wish = self._unit(near)
        if keep:  # positions weigh a thousand times as much as the turn
            held = Poses(self.evaluate, self._scale, 1e-3 * self.length)
            turns = self.evaluate(self._scale.from_unit(wish))[1]
            first = replace(newton, task=held)
            u, _ = first.refine(wish, held.target(p, turns), steps=4 * _STEPS)
            u, distance = newton.refine(u, p)
        else:
            u, distance = newton.settle(wish, p, wish)
        self._again(newton, u, distance, p, wish)
        return self._scale.from_unit(u)

    def at_poses(
        self, p: Array, r: Array, near: Array, free: int | None = None
    ) -> Array:
        """Joints (n, dof) nearest to `near` (n, dof) for poses (n, 3), (n, 3, 3) of the base frame.

        Where none reaches a pose, those that come nearest.  A turn about an axis of the tip, `free`
        0 to 2, may be left open.
        """
        kernel = self.model.kernel
        if kernel is not None and kernel.poses:
            closed = self._closed is not None and free is None
            rows = (*self.to_sensor(p, r), near)
            q, sure = kernel.inverse_poses(*rows, _axis(free), far=not closed)
            rest = np.flatnonzero(sure != 1)
            if not closed:
                rest = np.flatnonzero(sure == 0)
        else:
            newton, target, wish = self._asked(p, r, near, free)
            u, left = newton.refine(wish, target, 1e-3 * TOLERANCE)
            row, across = twins(newton, u)
            if len(row):
                found = newton.refine(across, target[row], 1e-3 * TOLERANCE)
                newton.take_better(u, left, wish, row, *found)
            q = self._scale.from_unit(u)
            away = np.linalg.norm(self._scale.difference(u, wish), axis=1)
            spare = wish.shape[1] > _residuals(free)
            unsure = (away > SEARCH.surely) | spare
            rest = np.flatnonzero((left > TOLERANCE * self.length) | unsure)
        if len(rest):
            q[rest] = self._far_poses(p[rest], r[rest], near[rest], free, q[rest])
        return q

    def _far_poses(
        self, p: Array, r: Array, near: Array, free: int | None, beside: Array
    ) -> Array:
        """The nearest of all ways to poses; `beside` (n, dof) where they lead to none."""
        newton, target, wish = self._asked(p, r, near, free)
        ways = self._ways(p, r, near, free)
        owner = np.repeat(np.arange(len(p)), [len(rows) for rows in ways])
        u = self._unit(np.where(np.isfinite(beside), beside, near))
        left = np.linalg.norm(
            newton.task.gap(target, newton.task.value_and_slope(u)[0]), axis=1
        )
        if len(owner):
            v = self._scale.to_unit(np.concatenate(ways))
            v, left_there = newton.settle(v, target[owner], wish[owner])
            newton.take_better(u, left, wish, owner, v, left_there)
        self._again(newton, u, left, target, wish)
        return self._scale.from_unit(u)

    def branches(
        self, p: Array, r: Array, near: Array, free: int | None = None
    ) -> list[Array]:
        """Joints (k, dof) of every way to poses (n, 3), (n, 3, 3) of the base frame, nearest first.

        Where none reaches a pose, those that come nearest; of the infinitely many of redundant
        joints some that are near to `near` (n, dof).
        """
        newton, target, wish = self._asked(p, r, near, free)
        spare = wish.shape[1] > _residuals(free)
        answers = []
        for i, rows in enumerate(self._ways(p, r, near, free)):
            u = self._scale.to_unit(rows)
            away = np.linalg.norm(self._scale.difference(u, wish[i]), axis=1)
            order = np.argsort(away, kind="stable")
            if spare:
                order = order[:_FAMILIES]
                target_i = np.repeat(target[i : i + 1], len(order), axis=0)
                wish_i = np.repeat(wish[i : i + 1], len(order), axis=0)
                u[order] = newton.settle(u[order], target_i, wish_i)[0]
            answers.append(self._scale.from_unit(u[order]))
        lost = np.array(
            [i for i, rows in enumerate(answers) if not len(rows)], dtype=np.intp
        )
        if len(lost):
            u, left = newton.refine(wish[lost], target[lost], 1e-3 * TOLERANCE)
            self._again(newton, u, left, target[lost], wish[lost])
            for i, q in zip(lost.tolist(), self._scale.from_unit(u), strict=True):
                answers[i] = q[None]
        return answers

    def _ways(self, p: Array, r: Array, near: Array, free: int | None) -> list[Array]:
        """Joints (k, dof) of every way to poses, none where nothing reaches them."""
        starts = np.zeros((len(p), 0, near.shape[1]))
        closed = self._closed is not None and free is None
        if closed:
            starts = self._closed_starts(p, r)
        spare = near.shape[1] > _residuals(free)
        kernel = self.model.kernel
        if kernel is not None and kernel.poses and not spare:
            q, count = kernel.inverse_poses_all(
                *self.to_sensor(p, r), starts, _axis(free)
            )
            return [rows[:k] for rows, k in zip(q, count.tolist(), strict=True)]
        newton, target, _ = self._asked(p, r, near, free)
        if closed:
            owner, u = refined_ways(
                newton, target, self._scale.to_unit(starts), self.length
            )
            q = self._scale.from_unit(u)
            edges = np.searchsorted(owner, np.arange(len(p) + 1)).tolist()
            return [q[a:b] for a, b in itertools.pairwise(edges)]
        arm = (self.evaluate, target, self._ranges, self.length)
        return searched_ways(*arm, free=free, starts=near)

    def _closed_starts(self, p: Array, r: Array) -> Array:
        """Starts (n, 8, 6) of poses by the drawing's closed form; NaN beyond the limits."""
        assert self._closed is not None  # noqa: S101
        structure: Any = self.body.structure
        groups = structure.groups
        beta = self.body.beta
        values = self._closed.joints(p, r)
        q = (values - beta[groups["offset"]]) / beta[groups["gain"]]
        q, inside = self._ranges.within(q, _ASIDE)
        return np.where(inside[..., None], q, np.nan)

    def _asked(
        self, p: Array, r: Array, near: Array, free: int | None
    ) -> tuple[Newton, Array, Array]:
        """The search of poses, its targets (n, 12) and what is wished for (n, dof)."""
        newton = self._posing
        if free is not None:
            task = Poses(self.evaluate, self._scale, self.length, free)
            newton = Newton(task, self._scale, self.length)
        return newton, Poses.target(p, r), self._unit(near)

    @cached_property
    def _closed(self) -> ClosedForm | None:
        """The closed form of the drawing, where it has one."""
        structure: Any = self.body.structure
        return ClosedForm.of(structure.chain)

    @cached_property
    def _ranges(self) -> Joints:
        about = self.model.about
        return Joints(about.lower, about.upper, about.revolute)

    def _again(
        self, newton: Newton, u: Array, left: Array, target: Array, wish: Array
    ) -> None:
        """Answers that missed their target, tried from all over the ranges; in place."""
        owner = np.repeat(np.flatnonzero(left > REACHED * self.length), _STARTS)
        if len(owner):
            tried = np.tile(drawn(_STARTS, u.shape[1]), (len(owner) // _STARTS, 1))
            found = newton.settle(tried, target[owner], wish[owner])
            newton.take_better(u, left, wish, owner, *found)

    def _unit(self, q: Array) -> Array:
        return self._placing.clip(self._scale.to_unit(q))

    @property
    def _scale(self) -> Scale:
        return self.model.motor.scale

    @cached_property
    def _placing(self) -> Newton:
        task = Positions.in_base(self.evaluate, self._scale)
        return Newton(task, self._scale, self.length)

    @cached_property
    def _posing(self) -> Newton:
        return Newton(
            Poses(self.evaluate, self._scale, self.length), self._scale, self.length
        )


def _residuals(free: int | None) -> int:
    """Number of residuals of a pose."""
    return 6 if free is None else 5


def _axis(free: int | None) -> int:
    """A free axis as the C source has it."""
    return -1 if free is None else free


def _undistorted(seen: Array, lens: Array) -> Array:
    """Directions (n, 2) as x/z, y/z of pixels `seen` (n, 2) through a lens (f, u0, v0, k1)."""
    f, u0, v0, k1 = lens
    bent = (seen - (u0, v0)) / f
    r = radius = np.linalg.norm(bent, axis=1)
    for _ in range(
        _LENS
    ):  # r (1 + k1 r^2) = radius by Newton's rule, not beyond the lens's fold
        r = r - (r * (1 + k1 * r * r) - radius) / np.maximum(1 + 3 * k1 * r * r, 1e-6)
    if (bad := ~(np.abs(r * (1 + k1 * r * r) - radius) <= 1e-9)).any():
        raise QueryError(
            f"pixel {seen[bad][0].round(1).tolist()} lies beyond what a lens of k1 {k1:.3g} can "
            f"show: expected one nearer to ({u0:.0f}, {v0:.0f})"
        )
    return np.asarray(bent * (r / np.where(radius > 0, radius, 1.0))[:, None])


def _in_base(body: Body | None, *, size: bool = True) -> Body | None:
    """A drawn body without its sensor, its outputs the tip in the base frame [m], by convention."""
    structure: Any = None if body is None else body.structure
    if body is None or structure.kind != "spatial" or not structure.informed:
        return None

    def alone(belief: _Belief) -> _Belief:
        # a base frame behind a sensor is turned about the first axis as the belief has it
        free = structure.view != "base"
        root = without_gauge(structure, belief, size) if free else belief.root
        own = belief.active
        kept = ~np.isin(belief.active, sensor_of(structure))
        beta = without_sensor(structure, belief.beta)[1]
        return replace(
            belief, beta=beta, active=own[kept], root=root[kept], noise=np.zeros(3)
        )

    base = without_sensor(structure, body.beta)[0]
    none = np.zeros(3)
    second = body.second and alone(body.second)
    return replace(alone(body), structure=base, tau=none, residual=none, second=second)


def _drawn(model: Parts) -> Body | None:
    """The drawn arm of a simulation whose arm and sensor were not changed."""
    about = model.about
    if (
        about.source != "simulation"
        or not about.urdf
        or (about.simulation or {}).get("changes")
    ):
        return None
    arm = arm_from_urdf(about.urdf, about.joint_names, about.tip, lock=about.locked)
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
