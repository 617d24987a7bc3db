"""Origins: how the joints of a URDF are moved by a calibration, in the axes of its root."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moved:
    """How far an origin is from where the URDF has it, seen with all joints at zero."""

    shift: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m], in the root link's axes
    # (3,) [rad], rotation vector in the same axes
    turn: Array = field(default_factory=lambda: np.zeros(3))
    value: float = 0.0  # [rad or m], what the joint's own motion is at zero: its offset
