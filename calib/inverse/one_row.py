"""One row: Newton's steps of a single query from joints that are near, for a control loop.

Each function gives up (None) where the answer of the batch may be another one: far from the start,
near a fold, or out of the joints' range.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..common.arrays import Array

FURTHEST = 0.1
"""Radians, or share of a slide's range: an answer further away may not be the nearest branch."""

_STEPS = 8  # of Newton; four lead from a wide start to rounding
_MET = 1e-15  # share of the extent at which a target is met
_CLOSE = 1e-12  # share of the extent at which a stalled step is met
_UNFOLDED = 0.2  # of the sine between the Jacobian's columns: no fold lies between start and answer
_LAST = 1e-9  # of the joints' range: what follows a step that is shorter is rounding
_LAST_OF_POSE = 1e-7  # rad: what follows is its square
_SLIDES = 25  # steps along a self-motion, each of which leaves a small share of the last

_Sloped = Callable[[Sequence[float]], tuple[float, float, Sequence[float], Sequence[float]]]
"""x, y and their derivatives by two joints."""


def two_joints(
    sloped: _Sloped,
    target: Sequence[float],
    start: Sequence[float],
    extent: float,
    inside: Callable[[Sequence[float]], bool],
) -> list[float] | None:
    """Two joints that reach a position (2,), in plain floats; parameters as `nearest_joints`."""
    a, b = start
    tx, ty = target
    least, stalled = _MET * extent, _CLOSE * extent
    last, facing = math.inf, 0.0
    for _ in range(_STEPS):
        x, y, (xa, xb), (ya, yb) = sloped((a, b))
        gx, gy = tx - x, ty - y
        distance = math.sqrt(gx * gx + gy * gy)
        det = xa * yb - xb * ya
        size = math.sqrt((xa * xa + ya * ya) * (xb * xb + yb * yb))
        sine = det / size if size > 0.0 else 0.0
        if facing == 0.0:
            facing = sine
        if sine * facing <= 0.0:
            return None
        if distance <= least or (distance >= 0.5 * last and distance <= stalled):
            room = _UNFOLDED * min(abs(sine), abs(facing))
            return [a, b] if max(abs(a - start[0]), abs(b - start[1])) <= room else None
        if distance > 2.0 * last:
            return None
        last = distance
        a += (yb * gx - xb * gy) / det
        b += (xa * gy - ya * gx) / det
        if not inside((a, b)):
            return None
    return None


def nearest_joints(
    sloped: Callable[[Sequence[float]], tuple[Sequence[float], Array]],
    target: Sequence[float],
    near: Sequence[float],
    span: Array,
    inside: Callable[[Sequence[float]], bool],
) -> list[float] | None:
    """Joints nearest to given ones that reach a position, of an arm with enough joints.

    sloped : position (m,) and its derivative (m, dof) at joints (dof,)
    target : [unit]
    near : [rad or m]
    span : (dof,) [rad or m], distances are counted in these units
    inside : whether joints are within their range

    Notes
    -----
    Each step solves the linearised problem as a whole: of all joints that reach the target the
    nearest to `near`, not to the last step's.  It converges by a factor of about the distance in
    radians; slides along the self-motion (`Newton.settle`) need ten times as many evaluations.
    """
    wish, aim = np.array(near), np.array(target)
    at, row, clear = wish, list(near), math.inf
    for _ in range(_SLIDES):
        x, jacobian = sloped(row)
        slope = jacobian * span
        back = (wish - at) / span
        force, share = _solved((slope @ slope.T).tolist(), (aim - x - slope @ back).tolist())
        clear = min(clear, share)
        if not clear > 0.0:
            return None
        step = back + slope.T @ force
        at = at + step * span
        row = at.tolist()
        if not inside(row):
            return None
        if max(map(abs, step.tolist())) < _LAST:
            room = _UNFOLDED * math.sqrt(clear)
            far = max(abs(now - then) for now, then in zip(row, near, strict=True))
            return row if far <= room else None
    return None


def _solved(power: list[list[float]], gap: list[float]) -> tuple[list[float], float]:
    """Solution of a symmetric system of two or three rows, and its determinant as a share.

    The share is that of what the diagonal allows (Hadamard): 1 where the Jacobian's rows are
    orthogonal, 0 at a fold.  In floats: a tenth of the time of LAPACK's call.
    """
    if len(gap) == 2:
        (a, b), (_, d) = power
        det, most = a * d - b * b, a * d
        if not det > 0.0:
            return gap, 0.0
        return [(d * gap[0] - b * gap[1]) / det, (a * gap[1] - b * gap[0]) / det], det / most
    (a, b, c), (_, d, e), (_, _, f) = power
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    dd, ee, ff = a * f - c * c, b * c - a * e, a * d - b * b
    det, most = a * aa + b * bb + c * cc, a * d * f
    if not det > 0.0:
        return gap, 0.0
    x, y, z = gap
    return [
        (aa * x + bb * y + cc * z) / det,
        (bb * x + dd * y + ee * z) / det,
        (cc * x + ee * y + ff * z) / det,
    ], det / most


def to_pose(
    twist: Callable[[Sequence[float], Any], tuple[Array, Array]], goal: Any, near: Sequence[float]
) -> list[float] | None:
    """Joints next to given ones (dof,) that reach a pose, of an arm with six joints or more.

    `twist` tells the twist (6,) that is left to the goal, and the Jacobian (6, dof), at joints.
    """
    at = np.array(near)
    for _ in range(_STEPS):
        residual, slope = twist(at.tolist(), goal)
        try:
            if len(near) == 6:
                step = np.linalg.solve(slope, residual)
            else:
                step = slope.T @ np.linalg.solve(slope @ slope.T, residual)
        except np.linalg.LinAlgError:
            return None
        length = max(map(abs, step.tolist()))
        at = at + step * (FURTHEST / max(length, FURTHEST))
        if length < _LAST_OF_POSE:
            found: list[float] = at.tolist()
            return found
    return None
