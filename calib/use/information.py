"""Information: the poses that tell most of an arm in space before its first measurement.

D-optimal design: each pose is the one that shrinks the volume of the body's posterior most, given
all poses before it (Fedorov 1972; for robots Borm and Menq 1991). The volume counts every parameter
by how well it is known, so that joint curves spread the poses over each joint's range.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..body.most_telling import greedy
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
    return greedy(tells(arm, q, measured), n)


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
    told, known = told[: len(q)], told[len(q) :].reshape(-1, told.shape[2])
    if not len(known):
        return np.asarray(told)
    # the posterior (I + T' T)^-1 of the measured rows T is R^-T R^-1, so that told R^-T tells it
    root = np.linalg.cholesky(np.eye(told.shape[2]) + known.T @ known)
    flat = np.linalg.solve(root, told.reshape(-1, told.shape[2]).T)
    return np.asarray(flat.T.reshape(told.shape))


def _directions(structure: SpatialStructure, q: Array, beta: Array, active: Index) -> Array:
    parts = [
        structure.linearise(q[i : i + _CHUNK], beta, active)[1] for i in range(0, len(q), _CHUNK)
    ]
    return np.concatenate(parts)
