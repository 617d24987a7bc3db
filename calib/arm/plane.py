"""Plane: where in space a planar arm's tip moves, and the axes it is measured along.

The axes follow one rule wherever a plane comes from: project the reference frame's x, y
and z axes onto the plane, take in that order the first two that lie 45 degrees or more
from the normal (and not on one line), and orthonormalise them with their signs kept. The
origin is the reference frame's origin, moved along the normal into the plane. A plane
parallel to xy therefore keeps the reference frame's own x and y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, freeze_copies
from ..common.rows import rms
from ..errors import LogError, RobotError

_NEAR_NORMAL = np.cos(np.pi / 4) + 1e-6
"""Axes closer to the normal than this (cosine of 45 degrees, rounding apart) are skipped."""

_MIN_ACROSS = 0.1
"""A second axis that leaves less than this across the first one is skipped too."""

_MIN_SPREAD = 1e-9
"""Points whose second spread is below this share of the first lie on a line."""


@dataclass(frozen=True, eq=False)
class Plane:
    """An oriented plane with two orthonormal axes."""

    # (3,) [m], the point of the plane whose coordinates are (0, 0)
    origin: Array
    x: Array  # (3,), unit axis
    y: Array  # (3,), unit axis

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        freeze_copies(self, "origin", "x", "y")

    @property
    def normal(self) -> Array:
        """Unit normal, x cross y, shape (3,)."""
        return np.cross(self.x, self.y)

    @property
    def basis(self) -> Array:
        """Rows x, y and normal, shape (3, 3): `basis @ (p - origin)` is p in the plane."""
        return np.stack([self.x, self.y, self.normal])

    def project(self, points: ArrayLike) -> Array:
        """Coordinates in the plane, (n, 2) or (2,), of points in space, (n, 3) or (3,) [m]."""
        offsets = np.asarray(points, dtype=float) - self.origin
        return offsets @ np.stack([self.x, self.y], axis=1)

    def distances(self, points: ArrayLike) -> Array:
        """Signed distances of points from the plane along the normal, (n, 3) -> (n,) [m]."""
        return (np.asarray(points, dtype=float) - self.origin) @ self.normal


def plane_of(normal: ArrayLike, through: ArrayLike) -> Plane:
    """Return the plane across a normal through a point, with the axes of the module's rule.

    normal : (3,), any vector across the plane; its sign and length do not matter
    through : (3,) [m], a point of the plane, in the reference frame
    """
    n = np.asarray(normal, dtype=float)
    n = n / np.linalg.norm(n)
    x: Array | None = None
    for axis in np.eye(3):
        if abs(axis @ n) > _NEAR_NORMAL:
            continue
        flat = axis - (axis @ n) * n
        if x is None:
            x = flat / np.linalg.norm(flat)
            continue
        across = flat - (flat @ x) * x
        if np.linalg.norm(across) > _MIN_ACROSS:
            origin = (np.asarray(through, dtype=float) @ n) * n
            return Plane(origin, x, across / np.linalg.norm(across))
    # only for a normal of NaN
    raise RobotError(f"no plane lies across the normal {n}")


def fit_plane(points: ArrayLike) -> tuple[Plane, float]:
    """Fit a plane to points in space by least squares.

    The plane passes through the centroid across the direction of least spread (SVD). Its
    origin and axes follow the module's rule, so the result does not depend on the SVD's
    signs, and positions keep the directions in which the sensor reported them.

    points : (n, 3) [m], at least three points that do not lie on one line
    Returns the plane and rms [m], root mean square distance of the points from the plane
    """
    p = np.asarray(points, dtype=float)
    spans = (
        p.ndim == 2 and p.shape[1] == 3 and len(p) > 2 and np.isfinite(p).all()
    )
    if spans:
        centroid = p.mean(axis=0)
        # SVD of the centred points, not their normal equations: those lose half the digits
        _, spread, directions = np.linalg.svd(p - centroid, full_matrices=False)
        spans = spread[1] > _MIN_SPREAD * max(spread[0], np.finfo(float).tiny)
    if not spans:
        raise LogError(
            "a plane needs at least 3 finite positions of shape (n, 3) that do not lie on one "
            f"line, got shape {p.shape}: add rows"
        )
    plane = plane_of(directions[2], centroid)
    return plane, rms(plane.distances(p))
