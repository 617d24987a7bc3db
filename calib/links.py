"""Links: Oja-Hebbian connections between the nodes of two maps, used in both directions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .maps.map import Map

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[np.float64]

BANDWIDTH = 0.7
"""Bandwidth of a node's activity (eq. 6) in units of the node spacing."""

NEAREST = 12
"""Nodes that are active at a time: further ones are below 1e-3."""

_WEAK = 0.02  # links below this share of the strongest of their node are let go
_NOTHING = 1e-6  # and those below this share of the strongest of all


def activity(network: Map, u: Array, bandwidth: float = BANDWIDTH) -> csr_array:
    """Activity a_j of the nodes nearest to each row of `u` (eq. 6).

    Parameters
    ----------
    network : Map
        Motor or sensory map.
    u : (n, d) array
        Points in the unit box.
    bandwidth : float
        Width sigma of the Gaussian in units of the node spacing.

    Returns
    -------
    csr_array of shape (n, nodes)
        exp(-|w_j - u|^2 / sigma^2), relative to the winner's, which is never zero even for
        a point far from every node.
    """
    from scipy.sparse import csr_array

    k = min(NEAREST, network.size)
    distance, index = network.nearest(u, k)
    square = distance**2
    a = np.exp((square[:, :1] - square) / (bandwidth * network.spacing) ** 2)  # eq. 6
    rows = np.arange(0, a.size + 1, k)
    return csr_array((a.ravel(), index.ravel(), rows), shape=(len(u), network.size))


def link(a_motor: csr_array, a_sensory: csr_array, beta: float = 1.0) -> csr_array:
    """Links at the fixed point of Oja's rule (eq. 5, with the forgetting factor of eq. 11).

    Where the mean change of eq. 11 vanishes, c_ij = <a_i a_j> / (beta <a_j^2>).  A node
    that was hardly ever active has not come that far: its links stand at the share
    1 - exp(-beta sum a_j^2) of it that the rule, at a learning rate of one, has reached.

    Parameters
    ----------
    a_motor, a_sensory : csr_array of shape (n, nodes)
        Activities of both maps for the same samples.
    beta : float
        Forgetting factor.

    Returns
    -------
    csr_array of shape (motor nodes, sensory nodes)
        Weak links are left out.
    """
    from scipy.sparse import csr_array

    together = (a_motor.T @ a_sensory).tocsr()
    square = np.asarray(a_sensory.multiply(a_sensory).sum(axis=0)).ravel()
    exposure = beta * square
    reached = -np.expm1(-exposure)
    scale = np.divide(reached, exposure, out=np.zeros_like(square), where=exposure > 0)
    together.data *= scale[together.indices]
    rows = np.repeat(np.arange(together.shape[0]), np.diff(together.indptr))
    row_max = np.maximum.reduceat(
        np.append(together.data, 0.0), np.minimum(together.indptr[:-1], together.nnz)
    )
    column_max = np.zeros(together.shape[1])
    np.maximum.at(column_max, together.indices, together.data)
    keep = together.data >= _WEAK * np.minimum(row_max[rows], column_max[together.indices])
    keep &= together.data > _NOTHING * together.data.max(initial=0.0)
    kept = csr_array(
        (together.data[keep], (rows[keep], together.indices[keep])), shape=together.shape
    )
    kept.sort_indices()
    kept.data = kept.data.astype(np.float32).astype(float)  # as a model file keeps them
    return kept


def oja(links: Array, a_motor: Array, a_sensory: Array, eta: float, beta: float = 1.0) -> None:
    """One step of Oja's rule on dense links, in place (eq. 5; eq. 11 with `beta`).

    Parameters
    ----------
    links : (motor nodes, sensory nodes) array
        c_ij, changed in place.
    a_motor, a_sensory : (motor nodes,), (sensory nodes,) array
        Activities a_i and a_j of one sample.
    eta : float
        Learning rate.
    beta : float
        Forgetting factor.
    """
    i, j = np.flatnonzero(a_motor), np.flatnonzero(a_sensory)
    c = links[:, j]
    c -= eta * beta * c * a_sensory[j] ** 2
    c[i] += eta * np.outer(a_motor[i], a_sensory[j])
    links[:, j] = c
