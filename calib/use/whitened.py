"""Whitened Jacobian: what readings tell of parameters, in units of noise and prior."""

from collections.abc import Sequence

import numpy as np

from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from .settings import PLANNING


def whitened_jacobian(
    structure: SpatialStructure,
    beta: Array,
    rows: Array,
    groups: Sequence[str],
    noise: float,
) -> Array:
    """Return the derivative (n, m, k) of readings by k parameters, both divided by their sd.

    rows : (n, dof + g), joint values, and what else the sensor has to know of a row
    groups : of the parameters; their sd is that of the prior, where a plan does not limit it
    noise : sd of a reading [unit]
    """
    prior = structure.prior(groups)
    sd = np.minimum(prior.sd, PLANNING.widest)
    lens = structure.groups["lens"]
    sd[lens] = prior.sd[lens]  # pixels of a lens have wide priors
    slope = structure.linearise(rows, beta, prior.active)[1]
    return slope * sd[prior.active] / noise
