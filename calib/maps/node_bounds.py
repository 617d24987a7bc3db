"""Expected error: a bound that holds for 95 % of the queries, learned from held-out errors."""

import numpy as np

from ..common.arrays import Array, Mask
from .blend import Blend
from .map import Map, nearest_points
from .settings import BOUND


def learn_bounds(
    motor: Map,
    u: Array,
    errors: Array,
) -> Array:
    """Learn a 95 % bound on the error for each motor node.

    Locally scaled, split conformal prediction (Lei et al. 2018): the mean held-out error around a
    node tells how bounds compare, the 95 % quantile of error over bound how large they are; apart
    for nodes near a limit, where maps are worst, unless either group has too few samples.

    u, errors : (n, dof), (n,) [unit], samples in the unit box that training never saw, their errors
    Returns (nodes,) [unit].
    """
    largest = float(errors.max(initial=0.0))
    floor = max(1e-9 * largest, 1e-15)
    most = max(1, len(u) // 2)
    k = min(BOUND.around, most)
    places = motor.units_in_box
    _, near = nearest_points(u, motor.scale, places, k)
    mean = errors[near].mean(axis=1)
    bound = np.maximum(mean, floor)
    blend = Blend(motor, u)
    groups = _groups(motor, u)
    # both groups' nodes bound samples between them: again, until both fit
    for _ in range(BOUND.passes):
        for members, rows in groups:
            stated = blend.mean(bound[blend.index])[rows]
            ratio = np.sort(errors[rows] / stated)
            # the finite-sample quantile of conformal prediction
            within = (len(ratio) + 1) * BOUND.coverage
            rank = int(np.ceil(within)) - 1
            quantile = ratio[min(rank, len(ratio) - 1)]
            bound[members] *= max(quantile, BOUND.least)
    return np.asarray(bound)


def _groups(motor: Map, u: Array) -> list[tuple[Mask, Mask]]:
    """Nodes (nodes,) and samples (n,) inside, and near a limit; all in one if either are few."""
    nodes = near_border(motor, motor.units)
    rows = near_border(motor, u)
    at_border = np.count_nonzero(rows)
    if min(at_border, len(rows) - at_border) < BOUND.enough:
        return [(np.ones_like(nodes), np.ones_like(rows))]
    return [(~nodes, ~rows), (nodes, rows)]


def near_border(motor: Map, u: Array) -> Mask:
    """Whether points (n, dof) of the unit box are near a joint limit, (n,)."""
    distance = np.minimum(u, 1.0 - u)
    distance = np.where(motor.scale.periodic, np.inf, distance)
    to_limit = distance.min(axis=1)
    return np.asarray(to_limit < BOUND.border * motor.spacing)
