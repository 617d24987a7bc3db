"""Joints at other times than those at which they were recorded."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Mask
from ..errors import OptionError

MAX_GAP = 0.1
"""Joints further apart than this are not interpolated between [s]."""

SETTLE = 0.04
"""Time before and after, over which a joint's speed is taken: encoders count in steps [s]."""


def joints_at(when: Array, time: Array, q: Array) -> Array:
    """Interpolate joints q (m, joints), recorded at times (m,), to times `when` (n,) [s]."""
    return np.stack([np.interp(when, time, column) for column in q.T], axis=1)


def joint_speed(when: Array, time: Array, q: Array) -> Array:
    """Return the fastest joint's speed about each time (n,) [rad/s or m/s]; see `joints_at`."""
    before = joints_at(when - SETTLE, time, q)
    after = joints_at(when + SETTLE, time, q)
    return np.asarray(np.abs(after - before).max(axis=1) / (2.0 * SETTLE))


def check_limits(max_gap: float, still: float | None) -> None:
    """Refuse limits of `covered` and of the joints' speed that leave nothing."""
    for name, value in {"max_gap": max_gap, "still": still}.items():
        if value is not None and not value > 0:
            raise OptionError(f"`{name}={value:g}`: expected more than zero")


def covered(when: Array, time: Array, max_gap: float) -> dict[str, Mask]:
    """Tell which times (n,) lie between no joints that are close enough to interpolate, and why.

    Joints have times (m,), and are close at most `max_gap` [s] apart.
    """
    after = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    outside = (when < time[0]) | (when > time[-1])
    far = ~outside & (time[after] - time[after - 1] > max_gap)
    return {
        "outside of the joints' times": outside,
        f"joints more than {max_gap:g} s apart": far,
    }
