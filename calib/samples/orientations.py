"""Orientations: quaternions or roll, pitch and yaw of a log, checked and made unit quaternions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import exponential, quaternion_of
from ..errors import LogError

Array = NDArray[np.float64]

QUATERNION = ("qx", "qy", "qz", "qw")
ANGLES = ("roll", "pitch", "yaw")
#: A quaternion's length may differ from 1 by this much: files round to a few digits.
ROUNDING = 0.01
#: Roll, pitch and yaw beyond it [rad] are in another unit.
_MOST = 2 * np.pi + 0.1


def unit_quaternions(values: Array, label: str) -> Array:
    """Unit quaternions (n, 4) with qw >= 0 of a log's quaternions qx, qy, qz, qw.

    Raises LogError if one has no length near 1: it is no orientation.
    """
    length = np.linalg.norm(values, axis=1)
    bad = np.abs(length - 1) > ROUNDING
    if bad.any():
        row = int(np.argmax(bad))
        shown = ", ".join(f"{value:.4g}" for value in values[row])
        raise LogError(
            f"{label}: {int(bad.sum()):,} of {len(values):,} rows hold no orientation, the first "
            f"(usable row {row + 1}) has qx, qy, qz, qw = {shown} of length {length[row]:.4g}, "
            "expected 1; leave those rows out, or check which columns are named"
        )
    unit = values / length[:, None]
    return np.asarray(np.where(unit[:, 3:] < 0, -unit, unit))


def from_angles(angles: Array) -> Array:
    """Unit quaternions (n, 4) of roll, pitch and yaw (n, 3) [rad].

    As in URDF: turns about the fixed x, then y, then z axis.

    Raises LogError if they are beyond a turn: they are in degrees.
    """
    most = float(np.abs(angles).max(initial=0.0))
    if most > _MOST:
        raise LogError(
            f"roll, pitch and yaw reach {most:.4g}, in rad more than a turn",
            hint="convert them to rad, or give `degrees=True` if all angles are in degrees",
            parameter="degrees",
        )
    x, y, z = (exponential(angles[:, k, None] * np.eye(3)[k]) for k in range(3))
    return quaternion_of(z @ y @ x)
