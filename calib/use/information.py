"""Information: the poses that tell most of an arm in space before its first measurement.

D-optimal design: each pose is the one that shrinks the volume of the body's posterior most, given
all poses before it (Fedorov 1972; for robots Borm and Menq 1991). The volume counts every parameter
by how well it is known, so that joint curves spread the poses over each joint's range.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..body.spatial import SpatialStructure, structure_of

if TYPE_CHECKING:
    from ..arm.spatial_arm import SpatialArm

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_NOISE = 1e-4  # [m] of a sensor that is not known yet
_CHUNK = 200


def most_telling_of_arm(arm: SpatialArm, q: Array, n: int, measured: Array) -> Index:
    """Choose n poses of an arm that was never measured, (n,) rows of `q` (m, dof) [rad or m].

    `measured` (k, dof) are poses whose rows exist, of which no belief knows yet.
    """
    return most_telling(tells(arm, q, measured), n)


def tells(arm: SpatialArm, q: Array, taken: Array) -> Array:
    """Directions (m, p, k) in which poses tell of the body, in units of noise and of the prior.

    Parameters
    ----------
    arm : SpatialArm
    q : (m, dof) array [rad or m]
        Poses to choose from.
    taken : (t, dof) array [rad or m]
        Poses that were measured.
    """
    structure = structure_of(arm, "rigid")
    free = ("view.rotation", "view.shift", "tool", "placement", "offset", "elastic", "curve")
    prior = structure.prior(free)
    told = _directions(structure, np.vstack([q, taken]), structure.neutral(), prior.active)
    told = told * (prior.sd[prior.active] / _NOISE)
    for row in range(len(q), len(told)):
        told = _without(told, told[row])
    return np.asarray(told[: len(q)])


def most_telling(told: Array, n: int) -> Index:
    """Choose n poses one by one, each the most telling after all before it, (n,) rows of `told`."""
    chosen = np.empty(n, dtype=np.intp)
    free = np.ones(len(told), dtype=bool)
    for k in range(n):
        spread = told @ np.swapaxes(told, 1, 2) + np.eye(told.shape[1])
        gain = np.where(free, np.linalg.slogdet(spread)[1], -np.inf)
        chosen[k] = row = int(gain.argmax())
        free[row] = False
        told = _without(told, told[row])
    return chosen


def _directions(structure: SpatialStructure, q: Array, beta: Array, active: Index) -> Array:
    parts = [
        structure.linearise(q[i : i + _CHUNK], beta, active)[1] for i in range(0, len(q), _CHUNK)
    ]
    return np.concatenate(parts)


def _without(told: Array, row: Array) -> Array:
    """What is left to tell once a pose (p, k) has been measured.

    The posterior I - a' (1 + a a')^-1 a is the square of I - u diag(1 - 1 / sqrt(1 + s^2)) u',
    with the singular vectors u and values s of a.
    """
    _, s, u = np.linalg.svd(row, full_matrices=False)
    return np.asarray(told - ((told @ u.T) * (1.0 - 1.0 / np.sqrt(1.0 + s**2))) @ u)
