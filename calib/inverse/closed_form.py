"""Closed form: all joints of a pose for six-joint arms whose drawing can be taken apart.

An arm with three parallel axes (2, 3, 4) and two that meet (5, 6), as Universal Robots builds them,
or with a spherical wrist behind two parallel axes (2, 3), as most others do, is a sequence of
circles that meet points, planes and spheres (Paden 1985; Elias and Wen 2022).  A calibrated arm is
not its drawing: answers are starts of a search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arm.rotations import exponential
from ..arm.spatial_chain import SpatialChain
from ..common.arrays import Array
from ..common.scale import TURN

#: Axes of a drawing meet, or are parallel, within this share of its length, or angle [rad].
_EXACT = 1e-4
WAYS = 8
"""Ways of six joints to a pose by the closed form."""


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """The axes of a drawing that can be taken apart, at zero in the base frame."""

    axes: Array  # (6, 3), unit vectors
    points: Array  # (6, 3) [m], a point of each axis
    meeting: Array  # (3,) [m], where the last axes meet
    tip: Array  # (3,) [m]
    rotation: Array  # (3, 3), of the tip
    # whether the last three axes meet; else axes 2, 3 and 4 are parallel
    spherical: bool

    @staticmethod
    def of(chain: SpatialChain) -> ClosedForm | None:
        """The closed form of a chain, None where it has none."""
        alone = np.array_equal(chain.coupling, np.eye(6))
        turning = all(chain.revolute) and not chain.bias.any()
        if chain.joints != 6 or not alone or not turning:
            return None
        axes = chain.axes
        points = chain.points
        size = max(chain.reach, 1e-9)
        meeting, gap = _meeting_point(axes[4:], points[4:])
        if gap > _EXACT * size or not _parallel(axes[1], axes[2]):
            return None
        away = np.linalg.norm(np.cross(axes[3], meeting - points[3]))
        spherical = bool(away < _EXACT * size)
        if not spherical and not _parallel(axes[1], axes[3]):
            return None
        return ClosedForm(
            axes, points, meeting, chain.tip, chain.rotation, spherical
        )

    def joints(self, position: Array, rotation: Array) -> Array:
        """Joint values (n, 8, 6) for poses (n, 3), (n, 3, 3); those out of reach come close.

        Every angle that there are two of gets an axis of its own in front.
        """
        n = len(position)
        turn = rotation @ self.rotation.T
        place = position + turn @ (self.meeting - self.tip)
        # the first joint brings the wrist into the plane in which the parallel axes move it
        away = place - self.points[0]
        height = self.axes[1] @ (self.meeting - self.points[0])
        back = _at_height(self.axes[0], away, self.axes[1], height)
        turns = _turns(self.axes[0], back)
        place = self.points[0] + _applied(turns, away)
        solve = self._spherical_arm if self.spherical else self._parallel_arm
        others = solve(turns @ turn, place)
        angles = np.broadcast_arrays(-back, *others)
        ways = np.stack(angles, axis=-1).reshape(WAYS, n, 6)
        q = np.swapaxes(ways, 0, 1)
        return np.asarray((q + np.pi) % TURN - np.pi)

    def _arm(self, place: Array, point: Array) -> tuple[Array, Array]:
        """Angles (2, ...) of joints 2 and 3 that bring a point (3,) to places (..., 3)."""
        axis = self.axes[1]
        link = _across(axis, self.points[2] - self.points[1])
        fore = _across(axis, point - self.points[2])
        goal = _across(axis, place - self.points[1])
        # |link + R fore| = |goal|
        squared = (goal**2).sum(axis=-1)
        height = (squared - link @ link - fore @ fore) / 2
        lower = _at_height(self.axes[2], fore, link, height)
        reached = link + _turns(self.axes[2], lower) @ fore
        return _angle(axis, reached, goal), lower

    def _spherical_arm(self, turn: Array, place: Array) -> tuple[Array, ...]:
        """Angles of joints 2 to 6 with a spherical wrist, given the first joint."""
        upper, lower = self._arm(place, self.meeting)
        shoulder = _turns(self.axes[1], upper)
        elbow = _turns(self.axes[2], lower)
        # what the wrist has to turn
        turn = np.swapaxes(shoulder @ elbow, -1, -2) @ turn
        first, second, third = self.axes[3:]
        goal = turn @ third
        middle = _at_height(second, third, first, goal @ first)
        bent = _turns(second, middle)
        one = _angle(first, bent @ third, goal)
        three = _angle(third, _back(bent, first), _back(turn, first))
        return upper, lower, one, middle, -three

    def _parallel_arm(self, turn: Array, place: Array) -> tuple[Array, ...]:
        """Angles of joints 2 to 6 with parallel axes 2, 3 and 4, given the first joint."""
        axis = self.axes[1]
        fifth = self.axes[4]
        sixth = self.axes[5]
        tilt = _at_height(fifth, sixth, axis, (turn @ sixth) @ axis)
        bent = _turns(fifth, tilt)
        spin = -_angle(sixth, _back(bent, axis), _back(turn, axis))
        # what is left of the turn is about the parallel axes
        wrist = bent @ _turns(sixth, spin)
        rest = turn @ np.swapaxes(wrist, -1, -2)
        steepest = np.argmin(np.abs(axis))
        side = _across(axis, np.eye(3)[steepest])
        total = _angle(axis, side, rest @ side)
        elbow = place - rest @ (self.meeting - self.points[3])
        upper, lower = self._arm(elbow, self.points[3])
        signs = self.axes[2:4] @ axis  # an axis may point the other way
        last = (total - upper - lower * signs[0]) * signs[1]
        return upper, lower, last, tilt, spin


def _meeting_point(axes: Array, points: Array) -> tuple[Array, float]:
    """The point (3,) nearest to two lines, and its distance from them."""
    # projections across each line
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    wanted = (across @ points[:, :, None]).sum(axis=0)[:, 0]
    point = np.linalg.lstsq(across.sum(axis=0), wanted, rcond=None)[0]
    gaps = (across @ (point - points)[:, :, None])[..., 0]
    return point, float(np.linalg.norm(gaps, axis=1).max())


def _parallel(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(np.cross(a, b)) < _EXACT)


def _turns(axis: Array, angle: Array) -> Array:
    """Rotations (..., 3, 3) about an axis (3,) by angles (...)."""
    return exponential(angle[..., None] * axis)


def _applied(rotation: Array, vectors: Array) -> Array:
    """Vectors (..., 3) turned by rotations (..., 3, 3)."""
    return np.asarray((rotation @ vectors[..., None])[..., 0])


def _back(rotation: Array, vector: Array) -> Array:
    """A vector (3,) turned back by rotations (..., 3, 3)."""
    return np.asarray(np.swapaxes(rotation, -1, -2) @ vector)


def _across(axis: Array, vectors: Array) -> Array:
    """What of vectors (..., 3) lies across an axis (3,)."""
    return np.asarray(vectors - (vectors @ axis)[..., None] * axis)


def _angle(axis: Array, start: Array, goal: Array) -> Array:
    """Angles (...) about an axis (3,) from vectors (..., 3) to others (..., 3)."""
    start = _across(axis, start)
    goal = _across(axis, goal)
    sine = np.cross(start, goal) @ axis
    return np.asarray(np.arctan2(sine, (start * goal).sum(axis=-1)))


def _at_height(
    axis: Array, vectors: Array, along: Array, height: Array | float
) -> Array:
    """Angles (2, ...) about an axis that bring vectors (..., 3) to heights along a direction.

    Both of each; where none does, the nearest.
    """
    across = _across(axis, vectors)
    cosine = across @ along
    sine = np.cross(axis, across) @ along
    size = np.hypot(cosine, sine)
    raised = (vectors @ axis) * (axis @ along)
    length = np.where(size > 0, size, 1.0)
    level = (height - raised) / length
    half = np.arccos(np.clip(level, -1.0, 1.0))
    middle = np.arctan2(sine, cosine)
    return np.stack([middle + half, middle - half])
