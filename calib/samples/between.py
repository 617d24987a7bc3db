"""Joints between two of their recorded times, for positions that another clock or topic stamped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def joints_at(when: Array, time: Array, q: Array) -> Array:
    """Interpolate joints q (m, joints), recorded at times (m,), to times `when` (n,) [s]."""
    return np.stack([np.interp(when, time, column) for column in q.T], axis=1)


def covered(when: Array, time: Array, max_gap: float) -> tuple[Mask, Mask, NDArray[np.intp]]:
    """Tell which times (n,) lie between joints that are close enough to interpolate.

    Returns
    -------
    inside, close : (n,) array of bool
        Whether a time lies within the recording, and between joints at most `max_gap` [s] apart.
    after : (n,) array of int
        The joints next after each time.
    """
    after = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    inside = (when >= time[0]) & (when <= time[-1])
    return inside, time[after] - time[after - 1] <= max_gap, after
