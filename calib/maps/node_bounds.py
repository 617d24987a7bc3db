"""Expected error: a bound that holds for 95 % of the queries, learned from held-out errors."""

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .local_models import blend, blend_size
from .map import Map, nearest_points
from .settings import BOUNDS


def learn_bounds(motor: Map, u: Array, errors: Array) -> Array:
    """Learn a 95 % bound on the error for each motor node.

    Locally scaled, split conformal prediction (Lei et al. 2018): the mean held-out error around a
    node tells how bounds compare, the 95 % quantile of error over bound how large they are; apart
    for nodes near a limit, where maps are worst, unless either group has too few samples.

    u, errors : (n, dof), (n,) [unit], samples in the unit box that training never saw, their errors
    Returns (nodes,) [unit].
    """
    floor = max(1e-9 * float(errors.max(initial=0.0)), 1e-15)
    k = max(1, min(BOUNDS.around, len(u) // 2))
    near = nearest_points(u, motor.scale, np.clip(motor.units, 0.0, 1.0), k)[1]
    border_rows = near_border(motor, u)
    border_nodes = near_border(motor, motor.units)
    groups = [(~border_nodes, ~border_rows), (border_nodes, border_rows)]
    if min(np.count_nonzero(rows) for _, rows in groups) < BOUNDS.enough:
        groups = [(np.ones_like(border_nodes), np.ones_like(border_rows))]
    bound: Array = np.maximum(errors[near].mean(axis=1), floor)
    index, weight, _ = blend(motor, u, blend_size(u.shape[1]))
    # both groups' nodes speak for samples between them: again, until both fit
    for _ in range(BOUNDS.passes):
        for members, rows in groups:
            stated = np.einsum("nm,nm->n", weight[rows], bound[index[rows]])
            ratio = np.sort(errors[rows] / stated)
            # the finite-sample quantile of conformal prediction
            rank = min(
                len(ratio) - 1,
                int(np.ceil((len(ratio) + 1) * BOUNDS.coverage)) - 1,
            )
            bound[members] *= max(ratio[rank], BOUNDS.least)
    return bound


def near_border(motor: Map, u: Array) -> NDArray[np.bool_]:
    """Whether points (n, dof) of the unit box are near a joint limit, (n,)."""
    away = np.minimum(u, 1.0 - u)
    away = np.where(motor.scale.periodic, np.inf, away)
    return np.asarray(away.min(axis=1) < BOUNDS.border * motor.spacing)


def blend_nodes(motor: Map, values: Array, u: Array) -> Array:
    """Values of the nodes (nodes,) blended at the points `u` (n, dof), (n,)."""
    index, weight, _ = blend(motor, u, blend_size(u.shape[1]))
    return np.asarray(np.einsum("nm,nm->n", weight, values[index]))
