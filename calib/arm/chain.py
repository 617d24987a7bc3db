"""Chain: the real transforms of an arm's active joints, folded and vectorised.

With every constant transform folded into the posture where all active joints are zero, a
serial chain is a product of one exponential per joint (Brockett's formula): the tip is the
zero posture's tip, moved by the joints from the last to the first,

    p(q) = exp(S_1 q_1) ... exp(S_n q_n) p(0),

where joint i turns about (or slides along) `axes[i]` through `points[i]`. Nothing is
assumed planar here: a joint that is not quite parallel to the others moves as it really does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError
from .plane import Plane

Array = NDArray[np.float64]

#: A link shorter than this [m] has no direction in which it could be lengthened.
MIN_LENGTH = 1e-9


@dataclass(frozen=True, eq=False)
class Chain:
    """Joint axes and tip of a serial chain at its zero posture, in the root frame.

    Attributes
    ----------
    axes : (dof, 3) array
        Unit axes, base to tip.
    points : (dof, 3) array [m]
        Origins of the joint frames; the axes pass through them.
    tip : (3,) array [m]
        Position of the tip.
    revolute : tuple of bool
        Whether each joint turns about its axis or slides along it.
    """

    axes: Array
    points: Array
    tip: Array
    revolute: tuple[bool, ...]

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("axes", "points", "tip"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.revolute)

    def positions(self, q: Array) -> Array:
        """Positions of the tip in space: (n, dof) [rad or m] -> (3, n) [m]."""
        v = np.repeat(self.tip[:, None], len(q), axis=1)
        for i in reversed(range(self.dof)):
            v = self._move(i, q[:, i], v)
        return v

    def velocities(self, q: Array) -> Array:
        """Differentiate the tip by the joints: (n, dof) [rad or m] -> (3, n, dof) [m or 1]."""
        v = np.repeat(self.tip[:, None], len(q), axis=1)
        columns: list[Array] = []
        for i in reversed(range(self.dof)):
            columns = [self._turn(i, q[:, i], column) for column in columns]
            moved = self._move(i, q[:, i], v)
            if self.revolute[i]:
                columns.append(_cross_matrix(self.axes[i]) @ (moved - self.points[i][:, None]))
            else:
                columns.append(np.repeat(self.axes[i][:, None], len(q), axis=1))
            v = moved
        return np.stack(columns[::-1], axis=-1)

    def rotations(self, q: Array) -> Array:
        """How the joints turn the tip's frame: (n, dof) [rad or m] -> (n, 3, 3)."""
        columns = [np.repeat(axis[:, None], len(q), axis=1) for axis in np.eye(3)]
        for i in reversed(range(self.dof)):
            columns = [self._turn(i, q[:, i], column) for column in columns]
        return np.moveaxis(np.stack(columns, axis=1), 2, 0).copy()

    def skeleton(self, q: Array) -> Array:
        """Joint origins and the tip: (n, dof) [rad or m] -> (n, dof + 1, 3) [m].

        A sliding joint's origin is drawn where it has slid to.
        """
        out = np.empty((len(q), self.dof + 1, 3))
        out[:, -1] = self.positions(q).T
        for k in range(self.dof):
            v = np.repeat(self.points[k][:, None], len(q), axis=1)
            for i in reversed(range(k + 1)):
                v = self._move(i, q[:, i], v)
            out[:, k] = v.T
        return out

    def links(self, plane: Plane) -> Array:
        """In-plane vectors from each joint to the next, the last to the tip: (dof, 3) [m]."""
        stops = np.vstack([self.points, self.tip])
        vectors = np.diff(stops, axis=0)
        return vectors - np.outer(vectors @ plane.normal, plane.normal)

    def with_link_length(self, joint: int, length: float, plane: Plane) -> Chain:
        """Return the chain with the link that a joint carries stretched in the plane.

        The zero posture's vector from this joint to the next (or to the tip) gets the new
        length; all that lies beyond is carried along.
        """
        link = self.links(plane)[joint]
        old = float(np.linalg.norm(link))
        if not np.isfinite(length) or length < 0:
            raise OptionError(f"link length {length:g} m: expected a finite number, 0 or more")
        if old < MIN_LENGTH:
            raise OptionError(
                f"the link of joint number {joint + 1} has no length in the plane: "
                "nothing can be stretched; change another joint's link"
            )
        shift = (length / old - 1.0) * link
        points = self.points.copy()
        points[joint + 1 :] += shift
        return replace(self, points=points, tip=self.tip + shift)

    def with_tip_offset(self, offset: Array, plane: Plane) -> Chain:
        """Return the chain with its tip moved within the last link.

        `offset` is (2,) [m]: along the last link (from the last joint to the tip) and to
        its left, seen against the plane's normal. Where that link has no length in the
        plane, the plane's own axes at the zero posture are used.
        """
        along = self.links(plane)[-1]
        length = float(np.linalg.norm(along))
        along = along / length if length >= MIN_LENGTH else plane.x
        left = np.cross(plane.normal, along)
        return replace(self, tip=self.tip + offset[0] * along + offset[1] * left)

    def _turn(self, i: int, angle: Array, v: Array) -> Array:
        """Turn vectors (3, n) as joint i does (a sliding joint leaves directions alone)."""
        if not self.revolute[i]:
            return v
        k = _cross_matrix(self.axes[i])
        # Rodrigues: R = 1 + sin(q) K + (1 - cos(q)) K^2
        turned: Array = v + np.sin(angle) * (k @ v) + (1.0 - np.cos(angle)) * (k @ k @ v)
        return turned

    def _move(self, i: int, value: Array, v: Array) -> Array:
        """Move positions (3, n) by joint i at values (n,)."""
        if not self.revolute[i]:
            return np.asarray(v + self.axes[i][:, None] * value)
        point = self.points[i][:, None]
        return np.asarray(point + self._turn(i, value, v - point))


def lever_lengths(points: Array, tip: Array, normal: Array) -> Array:
    """In-plane distances from each of some points to the next, the last to the tip.

    Parameters
    ----------
    points : (n, 3) array [m]
    tip : (3,) array [m]
    normal : (3,) array

    Returns
    -------
    (n,) array [m]
    """
    vectors = np.diff(np.vstack([points, tip]), axis=0)
    flat = vectors - np.outer(vectors @ normal, normal)
    return np.asarray(np.linalg.norm(flat, axis=1))


def chunks(n: int, size: int = 65_536) -> Iterator[slice]:
    """Slices that cover n rows, few enough each to stay in the processor's cache."""
    return (slice(start, min(start + size, n)) for start in range(0, n, size))


def _cross_matrix(axis: Array) -> Array:
    """Matrix K with K v = axis x v."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
