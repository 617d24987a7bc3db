"""Space: what the chain of an arm in space answers, in its base frame: poses, pixels on a plane.

Positions in the sensor's frame are answered by the model itself, see `calib.Model.solve`. This is
for what needs the chain: poses, positions near joints, and the base frame of a camera or tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arm.rotations import exponential, logarithm, quaternion_of
from ..body.belief import Body
from ..body.spatial_view import look
from ..body.views import is_camera
from ..common.arrays import Array
from ..common.rows import checked_rows
from ..errors import QueryError
from ..inverse.near import position_near
from ..inverse.pixel import on_plane
from ..inverse.pose import Joints, Reached, pose_branches, reach_poses
from ..inverse.self_motions import free_directions
from .base import drawn, in_base

if TYPE_CHECKING:
    from .model import Model

_KEEP = 10.0  # a turn of the tool beside a motion of the joints
#: A pose or a position counts as reached within this share of the arm's length.
REACHED = 1e-6
_STARTS = 64


@dataclass(frozen=True, eq=False)
class Space:
    """The arm of a model in its base frame."""

    model: Model
    body: Body  # the body in the view "base", in m
    joints: Joints
    length: float  # [m], the arm's length

    @staticmethod
    def of(model: Model) -> Space:
        """The arm of a model.

        Raises QueryError if the model knows no chain in space: of a planar arm, or one found from
        rows alone.
        """
        about = model.about
        body = in_base(model.body) if model.body is not None else None
        if body is None and about.source == "simulation":
            body = drawn(model)
        if body is None:
            raise QueryError(
                "the model knows no arm in space in its base frame: expected one that was learned "
                "from a log together with the robot that it is of"
            )
        structure: Any = body.structure
        joints = Joints(about.lower, about.upper, about.revolute)
        return Space(model, body, joints, max(structure.chain.reach, 1e-9))

    def evaluate(self, q: Array) -> tuple[Array, Array, Array]:
        """Position (n, 3) [m], orientation (n, 3, 3) and Jacobian (n, 6, dof) of the tip."""
        seen, slope = self._posed.predict_and_slope(q, self.body.beta)
        return seen[:, :3], exponential(seen[:, 3:]), slope

    @cached_property
    def _posed(self) -> Any:
        structure: Any = self.body.structure
        return structure.with_view("pose")

    def forward(self, q: ArrayLike) -> tuple[Array, Array]:
        """Position (n, 3) [m] and quaternion (n, 4) of the tip; NaN where the model has none."""
        rows, _ = checked_rows(q, self.model.about.joint_names, "joint values")
        structure: Any = self.body.structure
        position, rotation = structure.pose(rows, self.body.beta)
        known = np.isfinite(self.model.forward(rows)[:, :1])
        return np.where(known, position, np.nan), np.where(known, quaternion_of(rotation), np.nan)

    def bound(self, q: ArrayLike, *, size: bool = True) -> Array:
        """95 % bound (n,) in the base frame [m], which stands where the belief has it.

        Its turn about and its shift along the first joint's axis are a convention, see `in_base`.
        A camera cannot tell the arm's size either: without `size` that is left out too.
        """
        own = self.model.body
        body = self.body if size or own is None else in_base(own, size=False) or self.body
        return body.bound(np.atleast_2d(np.asarray(q, dtype=float)), noise=False)

    def to_sensor(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Positions (n, 3) [unit] and orientations (n, 3, 3) in the sensor's frame."""
        turn, shift, scale = self.sensor
        return scale * position @ turn.T + shift, turn @ rotation

    def to_base(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Positions (n, 3) [m] and orientations (n, 3, 3) in the base frame."""
        turn, shift, scale = self.sensor
        return (position - shift) @ turn / scale, turn.T @ rotation

    def pixels_on_plane(self, pixels: ArrayLike, height: float) -> Array:
        """Points (n, 3) [m] of the plane z = height of the base frame that pixels (n, 2) show.

        Raises QueryError if the model is of no camera, or a line of sight meets the plane nowhere
        before it.
        """
        rows, _ = checked_rows(pixels, ("x", "y"), "pixels")
        if not self.camera:
            raise QueryError("a pixel on a plane needs a model that was learned from pixels u, v")
        turn, shift, _ = self.sensor
        own: Any = self.model.body
        lens = own.beta[own.structure.groups["lens"]]
        points = on_plane(rows, turn, shift, lens, np.array([0.0, 0.0, 1.0]), height)
        if not np.isfinite(points).all():
            row = int(np.argmin(np.isfinite(points).all(axis=1)))
            raise QueryError(
                f"pixel {rows[row].round(1).tolist()} shows no point of the plane z = {height:g} m "
                "in front of the camera: its line of sight runs along the plane or away from it"
            )
        return points

    @property
    def camera(self) -> bool:
        """Whether the sensor is a camera, so that its readings are pixels."""
        return self.model.body is not None and is_camera(self.model.body.structure.view)

    @property
    def sensor(self) -> tuple[Array, Array, float]:
        """Rotation, shift and scale of the sensor: it sees ``scale rotation point + shift``."""
        own: Any = self.model.body
        if own is None or own.structure.kind != "spatial" or not own.structure.informed:
            return np.eye(3), np.zeros(3), 1.0  # a simulated sensor is in the base frame
        placed = own.structure.sensor(own.beta)
        return placed.rotation, placed.shift, placed.scale

    def reach_pose(
        self,
        position: ArrayLike,
        rotation: Array,
        near: Sequence[float] | None = None,
        branches: Array | None = None,
    ) -> Reached:
        """Joint values for a pose in the base frame: every branch, that nearest to `near` first.

        position, rotation : (3,) [m], (3, 3)

        Where none reaches it, the one that comes nearest; an arm of more than six joints has
        infinitely many, of which the nearest to `near` stands first.  `branches` (b, dof) are
        those of the pose where they are known.
        """
        p, r = np.asarray(position, dtype=float), rotation
        anchor = self.joints.middle if near is None else np.asarray(near, dtype=float)
        found = branches
        if found is None:
            (found,) = pose_branches(
                self.evaluate, p[None], r[None], self.joints, self.length, starts=anchor[None]
            )
        if len(found) and len(anchor) > 6:
            found = np.vstack([self._slid(found[self._order(found, anchor)[:4]], p, r, anchor)])
        if not len(found):
            starts = np.vstack([anchor, self.joints.draw(_STARTS, np.random.default_rng(0))])
            n = len(starts)
            q, _ = reach_poses(
                self.evaluate, starts, np.tile(p, (n, 1)), np.tile(r, (n, 1, 1)), self.length
            )
            q, _ = self.joints.within(q)
            # a radian of turn is worth the arm's length, as in the steps themselves
            misfit = self._answer(q, p, r)
            best = int(np.argmin(misfit.away + self.length * misfit.turned))
            return self._answer(q[[best]], p, r)
        return self._answer(found[self._order(found, anchor)], p, r)

    def reach_position(
        self, position: ArrayLike, near: Sequence[float] | None = None, *, keep: bool = False
    ) -> Reached:
        """Joint values nearest to `near` for a position in the base frame.

        Without `near`, nearest to the middle of the ranges. `keep` holds the orientation that
        the tip has at `near` as far as the joints allow.
        """
        p = np.asarray(position, dtype=float)
        anchor = self.joints.middle if near is None else np.asarray(near, dtype=float)
        q, distance = self._near(p, anchor[None], keep)
        if distance[0] > REACHED * self.length:  # the way from there may end at a limit
            q, distance = self._near(p, self.joints.draw(_STARTS, np.random.default_rng(0)), False)
            good = distance <= max(REACHED * self.length, 1.001 * distance.min())
            again, kept = self._slide_home(q[good], p, anchor, keep)
            q = again[[int(np.argmin(kept))]]
        return self._answer(q, p, None)

    def free(self, q: Array, rows: int) -> Array:
        """Directions (k, dof) that leave the answer at q (dof,); `rows` is 3, or 6 for a pose."""
        jacobian = self.evaluate(q[None])[2][0, :rows].copy()
        jacobian[:3] /= self.length
        return free_directions(jacobian)

    def sees(self, position: ArrayLike) -> NDArray[np.bool_]:
        """Whether a camera's picture shows points (n, 3) of the base frame, (n,)."""
        own: Any = self.model.body
        points = np.atleast_2d(np.asarray(position, dtype=float))
        if not self.camera:
            return np.ones(len(points), dtype=bool)
        sensor = own.structure.sensor(own.beta)
        ahead = (points @ sensor.rotation.T + sensor.shift)[:, 2] > 0
        view = look(sensor, points.T, np.repeat(np.eye(3)[:, :, None], len(points), axis=2))
        size = self.model.about.picture or tuple(2 * sensor.lens[1:3])
        inside = ((view.values >= 0) & (view.values <= size)).all(axis=1)
        # where the lens folds over, the picture shrinks as the point moves outwards
        out = view.point * np.array([[1.0], [1.0], [0.0]])
        return np.asarray(ahead & inside & ((view.seen(out) * out[:2]).sum(axis=0) >= 0))

    def _near(self, p: Array, starts: Array, keep: bool) -> tuple[Array, Array]:
        n = len(starts)
        return position_near(
            self.evaluate, np.tile(p, (n, 1)), starts, self.joints, self.length,
            keep=_KEEP if keep else 0.0,
        )  # fmt: skip

    def _slide_home(self, q: Array, p: Array, anchor: Array, keep: bool) -> tuple[Array, Array]:
        """Move solutions (n, dof) towards the anchor in halves; their distances from it (n,)."""
        for _ in range(6):
            tried, distance = self._near(p, 0.5 * (q + anchor), keep)
            nearer = self.joints.apart(tried, anchor) < self.joints.apart(q, anchor)
            nearer &= distance <= REACHED * self.length
            q = np.where(nearer[:, None], tried, q)
        return q, np.asarray(np.linalg.norm(q - anchor, axis=1))

    def _slid(self, q: Array, p: Array, r: Array, anchor: Array) -> Array:
        """Solutions (n, dof) of a redundant arm moved along their self-motion to the anchor."""
        n = len(q)
        targets = np.tile(p, (n, 1)), np.tile(r, (n, 1, 1))
        for _ in range(30):
            jacobian = self.evaluate(q)[2]
            jacobian[:, :3] /= self.length
            wish = anchor - q
            # (1 - J+ J) wish: what of it leaves the tip where it is
            inverse = np.linalg.pinv(jacobian, rcond=1e-6)
            step = wish - np.einsum("nij,nj->ni", inverse @ jacobian, wish)
            step *= np.minimum(1, 0.3 / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
            moved, distance = reach_poses(self.evaluate, q + step, *targets, self.length)
            moved, inside = self.joints.within(moved)
            better = inside & (distance < 1e-8 * self.length)
            better &= np.linalg.norm(moved - anchor, axis=1) < np.linalg.norm(q - anchor, axis=1)
            q = np.where(better[:, None], moved, q)
            if not better.any():
                break
        return q

    def _order(self, q: Array, anchor: Array) -> NDArray[np.intp]:
        span = self.joints.upper - self.joints.lower
        away = q - anchor
        # a joint of full turns is as near from the other side
        whole = 2 * np.pi * np.round(away / (2 * np.pi))
        away = away - np.where(self.model.motor.scale.periodic, whole, 0.0)
        return np.argsort(np.linalg.norm(away / span, axis=1), kind="stable")

    def _answer(self, q: Array, p: Array, r: Array | None) -> Reached:
        position, rotation, _ = self.evaluate(q)
        away, turned = np.linalg.norm(position - p, axis=1), np.zeros(len(q))
        if r is not None:
            turned = np.linalg.norm(logarithm(r @ np.swapaxes(rotation, 1, 2)), axis=1)
        good = (away <= REACHED * self.length) & (turned <= 10 * REACHED)
        return Reached(q, position, rotation, away, turned, bool(good.any()))
