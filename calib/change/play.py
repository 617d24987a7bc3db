"""Play: whether a joint of a log has more backlash than the model knows.

A joint that comes from one side stands by half its play from where it stands coming from the
other.  That is one more column of the equations: the slope of the readings by the joint, times the
side.  Whatever another change may follow of it is not play's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from .equations import Log
from .frame import Reference
from .score import RichNoise
from .settings import FALSE_ALARM, TEST_ROWS

_LEAST_PRECISION = 1e-12  # of the largest: less is rounding
# of a joint's rows that come from either side, or nothing tells its play
_LEAST_SHARE = 0.1
# of the squared residuals: what explains less does not pay in `calib.body.approach` either
_LEAST_EXPLAINED = 0.06


@dataclass(frozen=True)
class Play:
    """A joint that has more play than the model knows."""

    joint: int
    half: float  # half of its play [rad or m]
    deviation: float  # standard deviation of that
    score: float  # above 1 it is no chance
    dof: int

    @property
    def half_by_joint(self) -> Array:
        """Half of the play of each joint, (dof,) [rad or m]."""
        out = np.zeros(self.dof)
        out[self.joint] = self.half
        return out


def find_play(reference: Reference, log: Log, side: Array) -> Play | None:
    """Find the joint whose play explains most beside all that may have changed; None for chance.

    side : (n, dof), sign of each joint's last motion
    """
    from scipy.special import fdtrc

    side = side[thinned(len(log.q), TEST_ROWS)]
    log = log.some(TEST_ROWS)
    from_below = (side > 0).mean(axis=0)
    from_above = (side < 0).mean(axis=0)
    joints = np.flatnonzero(np.minimum(from_below, from_above) > _LEAST_SHARE)
    if not len(joints):
        return None
    structure = reference.structure
    beta = reference.beta
    residual = structure.residual(log.z, structure.predict(log.q, beta))
    moved = -structure.slope(log.q, beta)[..., joints] * side[:, None, joints]
    noise = RichNoise(reference, log, residual)
    equations = noise.equations
    y = equations.whiten(residual)
    columns = equations.whiten(moved)
    power, pull = equations.information(y, columns, noise.size)
    precision = np.diag(power)
    moving = precision > _LEAST_PRECISION * precision.max()
    # a joint whose play would not move what the sensor sees is no cause
    statistics = np.zeros(len(joints))
    statistics[moving] = (
        np.maximum(pull[moving], 0.0) ** 2 / precision[moving] / noise.temper
    )
    # an encoder that is noisy moves the tip along the same slope, to either side
    rest = equations.rest(y, noise.size)
    shares = np.zeros(len(joints))
    for k, column in enumerate(columns.T):
        moved_rest = equations.rest(column, noise.size)
        by_row = (moved_rest * rest).sum(axis=1)
        squares = float((moved_rest**2).sum() * (rest**2).sum()) + 1e-300
        shares[k] = float(by_row.sum()) ** 2 / squares
        by_chance = len(by_row) * float(by_row.var()) + 1e-300
        statistics[k] = min(statistics[k], float(by_row.sum()) ** 2 / by_chance)
    statistics[shares < _LEAST_EXPLAINED] = 0.0
    best = int(np.argmax(statistics))
    freedom = max(noise.left - 1.0, 1e-3)
    chance = min(1.0, len(joints) * float(fdtrc(1.0, freedom, statistics[best])))
    score = abs(math.log(max(chance, 1e-300)) / math.log(FALSE_ALARM))
    if score <= 1.0:
        return None
    half = float(pull[best] / precision[best])
    deviation = float(np.sqrt(noise.temper / precision[best]))
    return Play(int(joints[best]), half, deviation, score, side.shape[1])
