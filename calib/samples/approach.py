"""Direction of approach: from which side each joint came to where it stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STILL = 1e-9  # of a joint's largest move: less is no motion


def directions(q: Array) -> Array:
    """Sign of the last motion of each joint (n, dof), for joint values in the order of motion.

    1 or -1; 0 before a joint's first motion, where it is not known.

    Examples
    --------
    >>> directions(np.array([[0.0], [1.0], [1.0], [0.5]])).ravel().tolist()
    [0.0, 1.0, 1.0, -1.0]
    """
    step = np.diff(q, axis=0, prepend=q[:1])
    least = _STILL * np.abs(step).max(axis=0, initial=0.0)
    sign = np.where(np.abs(step) > least, np.sign(step), 0.0)
    # a joint that rests keeps the side from which it came
    moved = np.where(sign != 0.0, np.arange(len(q))[:, None], 0)
    latest = np.maximum.accumulate(moved, axis=0)
    return np.take_along_axis(sign, latest, axis=0)
