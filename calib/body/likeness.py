"""Likeness: how far what a body leaves over of one pose tells of another, over the joints."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .belief import Body

_SMOOTH = 0.5
"""Length [rad] over which the residual of a log is alike (Matern 5/2)."""


def matern(q: Array, other: Array, lengths: Array) -> Array:
    """Matern 5/2 correlation (n, k) of joints (n, dof) and (k, dof)."""
    a, b = q / lengths, other / lengths
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    d = np.sqrt(5.0 * np.maximum(square, 0.0))
    return np.asarray((1 + d + d * d / 3) * np.exp(-d))


def lengths_of(body: Body, q: Array) -> Array:
    """Correlation lengths (dof,) [rad or m] of a log's own residual."""
    turning = np.asarray(body.structure.revolute)
    span = np.maximum(np.ptp(q, axis=0), 1e-9)
    smooth = _SMOOTH * np.sqrt(body.structure.dof / 2)
    return np.asarray(np.where(turning, smooth, 0.3 * span))
