"""The radius to start again from: where training had the same distortion (eq. 10)."""

from __future__ import annotations

import numpy as np

from ..maps.map import Map


def matching_sigma(network: Map, error: float) -> float:
    """Neighbourhood radius [nodes] at which training had a quantization error (eq. 10).

    network : its history tells how the error fell with sigma; the radii of its coarse lattices
        count as the same share of the full one
    error : root mean square distance to the winner after the change, in the unit box
    Returns float, the radius of the whole map where the error is larger than at the start.
    """
    dim = len(network.lattice.shape)
    side = network.lattice.size ** (1 / dim)
    nodes, sigma, past = network.history[:, 0], network.history[:, 1], network.history[:, 2]
    full = sigma * side / nodes ** (1 / dim)
    # the error of an epoch is that of the radius before it
    past, full = past[1:], full[:-1]
    if not len(past) or error > past.max():
        return max(network.lattice.shape) / 2
    # the last epoch that was as bad
    epoch = int(np.flatnonzero(past >= error)[-1])
    if epoch + 1 == len(past) or past[epoch] == past[epoch + 1]:
        return float(full[epoch])
    share = (past[epoch] - error) / (past[epoch] - past[epoch + 1])
    return float(full[epoch] * (full[epoch + 1] / full[epoch]) ** share)
