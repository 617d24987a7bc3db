"""Servo: close the loop on the sensor with the learned Jacobian."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..common.rows import checked_rows
from ..errors import QueryError
from ..model.model import Model

_LONGEST = 0.1  # of the joints' range: no step is longer


def servo_step(
    model: Model, measured: ArrayLike, target: ArrayLike, q: ArrayLike, gain: float
) -> Array:
    """One step towards the targets; see :meth:`calib.Model.servo`."""
    if not 0.0 < gain <= 1.0:
        raise QueryError(f"gain {gain!r}: expected a share of the way, above 0 and up to 1")
    seen, _ = checked_rows(measured, model.axes, "measured position")
    wanted, _ = checked_rows(target, model.axes, "target")
    joints, single = checked_rows(q, model.about.joint_names, "q")
    if not len(seen) == len(wanted) == len(joints):
        raise QueryError(
            f"{len(seen)} measured positions, {len(wanted)} targets and {len(joints)} rows of "
            "q: expected as many of each"
        )
    scale, newton = model.motor.scale, model.solver.newton
    u = newton.clip(scale.to_unit(joints))
    step = newton.rate(u, gain * (wanted - seen))
    length = np.linalg.norm(step, axis=1, keepdims=True)
    step *= np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))
    result = scale.from_unit(newton.clip(u + step))
    return result[0] if single else result
