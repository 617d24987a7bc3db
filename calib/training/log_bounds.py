"""Bounds of a model that was learned from a log, for each motor node.

With a body they are its posterior's: they grow with the distance from the rows by
themselves.  Without one nothing is known beyond the rows, so the bound grows with the
distance as fast as the position can change.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..maps.node_bounds import learn_bounds
from ..model.model import Model

_RADIUS_95 = 2.448  # radius that holds 95 % of a 2-D Gaussian of standard deviation 1


def node_bounds(
    model: Model, u: Array, rows: NDArray[np.intp], errors: Array, *, has_models: bool
) -> tuple[Array, Array]:
    """Bounds (nodes,) on what the sensor reads and on the true position.

    Of a model whose bounds are still to be learned, of rows `u` (n, dof, unit box); `rows` (k,) of
    them were held out with `errors` (k,) [unit]; local models mend what the smooth part leaves over
    or not.
    """
    motor = model.motor
    nodes = np.clip(motor.units, 0.0, 1.0)
    if model.body is None:
        learned = learn_bounds(motor, u[rows], errors)
        return learned, learned  # they hold beside the rows, see `calib.model.trust`
    q = motor.scale.from_unit(nodes)
    reading = model.body.bound(q, noise=True)
    position = model.body.bound(q, noise=False)
    if has_models:
        # where held-out rows are further off than the body says, as in a local defect
        learned = learn_bounds(motor, u[rows], errors)
        noise = _RADIUS_95 * float(np.sqrt(np.mean(model.body.noise[:2] ** 2)))
        own = np.sqrt(np.maximum(learned**2 - noise**2, 0.0))
        position = np.where(learned > reading, np.maximum(position, own), position)
        reading = np.maximum(reading, learned)
    return reading, position
