"""Rigid motions as matrices (4, 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array


def rigid(turns: Array, shifts: ArrayLike) -> Array:
    """Rigid motions (..., 4, 4) of rotations (..., 3, 3) and shifts (..., 3)."""
    out = np.zeros((*np.shape(turns)[:-2], 4, 4))
    out[..., :3, :3] = turns
    out[..., :3, 3] = shifts
    out[..., 3, 3] = 1.0
    return out


def inverse(pose: Array) -> Array:
    """Inverse of rigid motions (..., 4, 4)."""
    back = np.swapaxes(pose[..., :3, :3], -1, -2)
    return rigid(back, -(back @ pose[..., :3, 3:])[..., 0])
