"""What a search for one pose or position of an arm in space ends with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reached:
    """Joint values that answer one target.

    Attributes
    ----------
    q : (k, dof) array [rad or m]
        The preferred one first.
    position, rotation : (k, 3) and (k, 3, 3) arrays [m]
        Where they put the tip, in the base frame.
    away : (k,) array [m]
        Distance from the position asked for.
    turned : (k,) array [rad]
        Turn from the orientation asked for, 0 where none was.
    reachable : bool
    """

    q: Array
    position: Array
    rotation: Array
    away: Array
    turned: Array
    reachable: bool
