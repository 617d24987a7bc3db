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
from ..common.rows import row_lengths
from ..common.scale import TURN

#: Axes of a drawing meet, or are parallel, within this share of its length, or angle [rad].
_EXACT = 1e-4
#: Between the two angles [rad] that come close to what is out of reach: a calibrated arm may have
#: both, and a search that begins on the fold between them finds neither.
_APART = 0.1


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
        if chain.joints != 6 or not all(chain.revolute) or chain.bias.any():
            return None
        if not np.array_equal(chain.coupling, np.eye(6)):
            return None
        axes = chain.axes
        points = chain.points
        size = max(chain.reach, 1e-9)
        meeting, gap = meeting_point(axes[4:], points[4:])
        exact = _EXACT * size
        if gap > exact or not _parallel(axes[1], axes[2]):
            return None
        moment = np.cross(axes[3], meeting - points[3])
        spherical = bool(np.linalg.norm(moment) < exact)
        if not spherical and not _parallel(axes[1], axes[3]):
            return None
        return ClosedForm(
            axes=axes,
            points=points,
            meeting=meeting,
            tip=chain.tip,
            rotation=chain.rotation,
            spherical=spherical,
        )

    def joints(self, position: Array, rotation: Array) -> Array:
        """Joint values (n, 8, 6) for poses (n, 3), (n, 3, 3); those out of reach come close.

        Every angle that has two values gets its own axis in front.
        """
        turn = rotation @ self.rotation.T
        wrist = position + turn @ (self.meeting - self.tip)
        # the first joint brings the wrist into the plane in which the parallel axes move it
        first, second = self.axes[:2]
        base = self.points[0]
        drawn_wrist = self.meeting - base
        height = second @ drawn_wrist
        base_to_wrist = wrist - base
        back = _at_height(
            first,
            base_to_wrist,
            second,
            height,
        )
        turns = _turns(first, back)
        in_plane = base + _rotate(turns, base_to_wrist)
        turn_left = turns @ turn
        if self.spherical:
            others = self._spherical_arm(turn_left, in_plane)
        else:
            others = self._parallel_arm(turn_left, in_plane)
        angles = np.broadcast_arrays(-back, *others)
        solutions = np.stack(angles, axis=-1).reshape(8, len(position), 6)
        q = np.swapaxes(solutions, 0, 1)
        return (q + np.pi) % TURN - np.pi

    def _arm(self, place: Array, point: Array) -> tuple[Array, Array]:
        """Angles (2, ...) of joints 2 and 3 that bring a point (3,) to places (..., 3).

        Upper arm ``a``, forearm ``f`` and goal ``g`` across the parallel axes are a triangle: the
        turn R of joint 3 has ``|a + R f| = |g|``, hence ``a . R f = (g . g - a . a - f . f) / 2``.
        """
        axis = self.axes[1]
        shoulder, elbow = self.points[1:3]
        upper_arm = _across(axis, elbow - shoulder)
        forearm = _across(axis, point - elbow)
        goal = _across(axis, place - shoulder)
        squared = (goal**2).sum(axis=-1)
        rest = squared - upper_arm @ upper_arm - forearm @ forearm
        bend_axis = self.axes[2]
        lower = _at_height(
            bend_axis,
            forearm,
            upper_arm,
            rest / 2,
        )
        bent_forearm = _turns(bend_axis, lower) @ forearm
        upper = _angle(axis, upper_arm + bent_forearm, goal)
        return upper, lower

    def _spherical_arm(self, turn: Array, place: Array) -> tuple[Array, ...]:
        """Angles of joints 2 to 6 with a spherical wrist, given the first joint.

        turn : (..., 3, 3), place : (..., 3) [m], what joints 2 to 6 have to reach
        """
        upper, lower = self._arm(place, self.meeting)
        shoulder_axis, elbow_axis, first, second, third = self.axes[1:]
        arm = _turns(shoulder_axis, upper) @ _turns(elbow_axis, lower)
        wrist = np.swapaxes(arm, -1, -2) @ turn
        goal = wrist @ third
        height = goal @ first
        middle = _at_height(
            second,
            third,
            first,
            height,
        )
        bent = _turns(second, middle)
        fourth = _angle(first, bent @ third, goal)
        start = _rotate_back(bent, first)
        end = _rotate_back(wrist, first)
        sixth = -_angle(third, start, end)
        return upper, lower, fourth, middle, sixth

    def _parallel_arm(self, turn: Array, place: Array) -> tuple[Array, ...]:
        """Angles of joints 2 to 6 with parallel axes 2, 3 and 4, given the first joint.

        turn : (..., 3, 3), place : (..., 3) [m], what joints 2 to 6 have to reach
        """
        axis = self.axes[1]
        fifth = self.axes[4]
        sixth = self.axes[5]
        goal = turn @ sixth
        height = goal @ axis
        tilt = _at_height(
            fifth,
            sixth,
            axis,
            height,
        )
        bent = _turns(fifth, tilt)
        start = _rotate_back(bent, axis)
        end = _rotate_back(turn, axis)
        spin = -_angle(sixth, start, end)
        wrist = bent @ _turns(sixth, spin)
        # what is left of the turn is about the parallel axes
        rest = turn @ np.swapaxes(wrist, -1, -2)
        steepest = np.argmin(np.abs(axis))
        side = _across(axis, np.eye(3)[steepest])
        total = _angle(axis, side, rest @ side)
        hand = self.meeting - self.points[3]
        forearm_end = place - rest @ hand
        upper, lower = self._arm(forearm_end, self.points[3])
        # an axis may point the other way
        signs = self.axes[2:4] @ axis
        rest_angle = total - upper - lower * signs[0]
        last = rest_angle * signs[1]
        return upper, lower, last, tilt, spin


def meeting_point(axes: Array, points: Array) -> tuple[Array, float]:
    """The point (3,) nearest to two lines, and its distance from them.

    With projections P = I - a a' across lines of directions a through points p it solves
    ``sum(P) x = sum(P p)``.
    """
    outer = axes[:, :, None] * axes[:, None, :]
    across = np.eye(3) - outer
    projected = _rotate(across, points)
    normal = across.sum(axis=0)
    wanted = projected.sum(axis=0)
    point = np.linalg.lstsq(normal, wanted, rcond=None)[0]
    gaps = _rotate(across, point - points)
    distances = row_lengths(gaps)
    return point, float(distances.max())


def _parallel(a: Array, b: Array) -> bool:
    sine = np.linalg.norm(np.cross(a, b))
    return bool(sine < _EXACT)


def _turns(axis: Array, angle: Array) -> Array:
    """Rotations (..., 3, 3) about an axis (3,) by angles (...)."""
    vectors = angle[..., None] * axis
    return exponential(vectors)


def _rotate(rotation: Array, vectors: Array) -> Array:
    """Turn vectors (..., 3) by rotations (..., 3, 3)."""
    columns = rotation @ vectors[..., None]
    return columns[..., 0]


def _rotate_back(rotation: Array, vector: Array) -> Array:
    """Turn a vector (3,) by the inverses of rotations (..., 3, 3)."""
    inverse = np.swapaxes(rotation, -1, -2)
    return inverse @ vector


def _across(axis: Array, vectors: Array) -> Array:
    """Components of vectors (..., 3) across an axis (3,)."""
    height = vectors @ axis
    along = height[..., None] * axis
    return vectors - along


def _angle(axis: Array, start: Array, goal: Array) -> Array:
    """Angles (...) about an axis (3,) from vectors (..., 3) to others (..., 3)."""
    start = _across(axis, start)
    goal = _across(axis, goal)
    sine = np.cross(start, goal) @ axis
    cosine = (start * goal).sum(axis=-1)
    return np.asarray(np.arctan2(sine, cosine))


def _at_height(
    axis: Array, vectors: Array, along: Array, height: Array | float
) -> Array:
    """Angles (2, ...) about an axis that bring vectors (..., 3) to heights along a direction.

    The height is ``c cos(angle) + s sin(angle)`` and what lies along the axis: both angles of each;
    where none does, both sides of the nearest.
    """
    across = _across(axis, vectors)
    cosine = across @ along
    sine = np.cross(axis, across) @ along
    size = np.hypot(cosine, sine)
    on_axis = vectors @ axis
    raised = on_axis * (axis @ along)
    length = np.where(size > 0, size, 1.0)
    level = (height - raised) / length
    within = np.clip(level, -1.0, 1.0)
    beyond = np.abs(level) > 1.0
    half = np.arccos(within) + beyond * _APART / 2
    middle = np.arctan2(sine, cosine)
    return np.stack([middle + half, middle - half])
