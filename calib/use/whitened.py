"""Whitened Jacobian: what readings tell of parameters, in units of noise and prior."""

from collections.abc import Sequence

import numpy as np

from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from .settings import PLANNING


def whitened_jacobian(
    structure: SpatialStructure,
    beta: Array,
    q: Array,
    groups: Sequence[str],
    noise: float,
) -> Array:
    """Return the derivative (n, m, k) of readings by k parameters, both divided by their sd.

    q : (n, dof), joint values [rad or m]
    groups : of the parameters; their sd is that of the prior, where a plan does not limit it
    noise : sd of a reading [unit]
    """
    prior = structure.prior(groups)
    sd = np.minimum(prior.sd, PLANNING.widest)
    slope = structure.linearise(q, beta, prior.active)[1]
    return slope * sd[prior.active] / noise
