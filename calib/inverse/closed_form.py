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
from ..common.arrays import Array, Index

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
        same = chain.joints == 6 and np.array_equal(chain.coupling, np.eye(6))
        if not same or not all(chain.revolute) or chain.bias.any():
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
        """Joint values (n, 8, 6) for poses (n, 3), (n, 3, 3); those out of reach come close."""
        n = len(position)
        turn = rotation @ self.rotation.T
        place = position + turn @ (self.meeting - self.tip)
        # the first joint brings the wrist into the plane in which the parallel axes move it
        away = place - self.points[0]
        height = self.axes[1] @ (self.meeting - self.points[0])
        base = _at_height(self.axes[0], away, self.axes[1], height, back=True)
        owner = np.tile(np.arange(n), 2)
        back = _turns(self.axes[0], -base)
        turn = back @ turn[owner]
        place = self.points[0] + _applied(back, away[owner])
        if self.spherical:
            upper, lower = self._arm(place, self.meeting)
            turn = np.tile(turn, (2, 1, 1))
            along = _turns(self.axes[1], upper) @ _turns(self.axes[2], lower)
            wrist = self._wrist(np.swapaxes(along, 1, 2) @ turn)
            reached = [np.tile(base, 4), np.tile(upper, 2), np.tile(lower, 2)]
            q = np.column_stack([*reached, *wrist])
            owner = np.tile(owner, 4)
        else:
            q, owner = self._parallel_arm(base, turn, place, owner)
        order = np.argsort(owner, kind="stable")
        return _wrapped(q[order]).reshape(n, WAYS, 6)

    def _arm(self, place: Array, point: Array) -> tuple[Array, Array]:
        """Angles (2n,) of joints 2 and 3 that bring a point (3,) to places (n, 3)."""
        axis = self.axes[1]
        link = _across(axis, self.points[2] - self.points[1])
        fore = _across(axis, point - self.points[2])
        wanted = _across(axis, place - self.points[1])
        # |link + R fore| = |wanted|
        size = (wanted**2).sum(axis=1) - link @ link - fore @ fore
        lower = _at_height(
            self.axes[2], np.tile(fore, (len(place), 1)), link, size / 2
        )
        reached = link + _applied(
            _turns(self.axes[2], lower), np.tile(fore, (len(lower), 1))
        )
        upper = _angle(axis, reached, np.tile(wanted, (2, 1)))
        return upper, lower

    def _wrist(self, turn: Array) -> tuple[Array, Array, Array]:
        """Angles (2n,) of the last three joints that make turns (n, 3, 3)."""
        first, second, third = self.axes[3:]
        aim = turn @ third
        middle = _at_height(
            second, np.tile(third, (len(turn), 1)), first, aim @ first
        )
        turn = np.tile(turn, (2, 1, 1))
        bent = _turns(second, middle)
        one = _angle(first, bent @ third, turn @ third)
        three = -_angle(
            third,
            np.swapaxes(bent, 1, 2) @ first,
            np.swapaxes(turn, 1, 2) @ first,
        )
        return one, middle, three

    def _parallel_arm(
        self, base: Array, turn: Array, place: Array, owner: Index
    ) -> tuple[Array, Index]:
        """Joints (4n, 6) of an arm with parallel axes 2, 3 and 4, given its first joint (n,)."""
        axis = self.axes[1]
        fifth = self.axes[4]
        sixth = self.axes[5]
        tilt = _at_height(
            fifth, np.tile(sixth, (len(turn), 1)), axis, (turn @ sixth) @ axis
        )
        base = np.tile(base, 2)
        owner = np.tile(owner, 2)
        turn = np.tile(turn, (2, 1, 1))
        place = np.tile(place, (2, 1))
        bent = _turns(fifth, tilt)
        spin = -_angle(
            sixth,
            np.swapaxes(bent, 1, 2) @ axis,
            np.swapaxes(turn, 1, 2) @ axis,
        )
        # what is left of the turn is about the parallel axes
        rest = turn @ np.swapaxes(bent @ _turns(sixth, spin), 1, 2)
        side = np.tile(self._side, (len(rest), 1))
        total = _angle(axis, side, _applied(rest, side))
        elbow = place - _applied(
            rest, np.tile(self.meeting - self.points[3], (len(rest), 1))
        )
        upper, lower = self._arm(elbow, self.points[3])
        base, total, tilt, spin = (
            np.tile(part, 2) for part in (base, total, tilt, spin)
        )
        signs = self.axes[2:4] @ axis  # an axis may point the other way
        last = (total - upper - lower * signs[0]) * signs[1]
        q = np.column_stack([base, upper, lower, last, tilt, spin])
        return q, np.tile(owner, 2)

    @property
    def _side(self) -> Array:
        """A direction (3,) across the parallel axes."""
        axis = self.axes[1]
        return _across(axis, np.eye(3)[np.argmin(np.abs(axis))])


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
    """Rotations (n, 3, 3) about an axis (3,) by angles (n,)."""
    return exponential(angle[:, None] * axis)


def _applied(rotation: Array, vectors: Array) -> Array:
    """Vectors (n, 3) turned by rotations (n, 3, 3)."""
    return np.asarray((rotation @ vectors[..., None])[..., 0])


def _across(axis: Array, vectors: Array) -> Array:
    """What of vectors (..., 3) lies across an axis (3,)."""
    return np.asarray(vectors - (vectors @ axis)[..., None] * axis)


def _angle(axis: Array, start: Array, goal: Array) -> Array:
    """Angles (n,) about an axis (3,) from vectors (n, 3) to others (n, 3)."""
    start = _across(axis, start)
    goal = _across(axis, goal)
    sine = np.cross(start, goal) @ axis
    return np.asarray(np.arctan2(sine, (start * goal).sum(axis=1)))


def _at_height(
    axis: Array,
    vectors: Array,
    along: Array,
    height: Array | float,
    *,
    back: bool = False,
) -> Array:
    """Angles (2n,) about an axis that bring vectors (n, 3) to heights (n,) along a direction.

    Both of each, one after all others; where none does, the nearest.  `back` turns the other way.
    """
    across = _across(axis, vectors)
    cosine = across @ along
    sine = np.cross(axis, across) @ along
    size = np.hypot(cosine, sine)
    level = (height - (vectors @ axis) * (axis @ along)) / np.where(
        size > 0, size, 1.0
    )
    half = np.arccos(np.clip(level, -1.0, 1.0))
    middle = np.arctan2(sine, cosine)
    angles = np.concatenate([middle + half, middle - half])
    return -angles if back else angles


def _wrapped(q: Array) -> Array:
    """Angles within half a turn of zero."""
    return np.asarray((q + np.pi) % (2 * np.pi) - np.pi)
