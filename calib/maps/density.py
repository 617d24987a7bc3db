"""Varying density: what equations 7 and 8 of the paper can mean, one gain each.

A gain is a factor on each sample's update.  Samples with a large gain draw more nodes to
where they are.  Every gain starts at 1, so that the map orders itself undisturbed, and
grows with the training's progress, as the paper asks.  ``docs/paper.md`` says which
sentence or equation each reading comes from and how they compare.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError
from .lattice import Lattice

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Visit:
    """Samples that visit a map in training, as a gain sees them.

    Attributes
    ----------
    progress : float
        t / T, from 0 at the start of the training to 1 at its end.
    winners : (n,) int array
        Best matching node of each sample (eq. 1).
    distances : (n,) array
        Distance of each sample to its winner, in the unit box.
    weights : (nodes, d) array
        Weights of the nodes, in the unit box.
    lattice : Lattice
        Where the nodes stand.
    """

    progress: float
    winners: NDArray[np.intp]
    distances: Array
    weights: Array
    lattice: Lattice


Gain = Callable[[Visit], Array]


def border(visit: Visit, strength: float = 6.0) -> Array:
    """Gain of nodes "with a small number of neighbors": corners, edges.

    g = exp(p t/T (1 - neighbours / most neighbours)).  It needs no distances, has no
    feedback and cannot tear the map.
    """
    lonely = 1.0 - visit.lattice.neighbours()
    gain: Array = np.exp(strength * visit.progress * lonely)[visit.winners]
    return gain


def error(visit: Visit, strength: float = 1.0) -> Array:
    """Gain of samples that the map represents badly.

    g = (d^2 / mean d^2)^(p t/T), d the distance to the winner: density follows the
    error, which is what the abstract promises.
    """
    square = visit.distances**2
    mean = float(square.mean())
    if mean == 0.0:
        return np.ones(len(square))
    return np.asarray((square / mean + 1e-6) ** (strength * visit.progress))


def _local_distances(visit: Visit) -> Array:
    """Sum over the lattice neighbours i of |w_j - w_i|^2, for each node j."""
    a, b = visit.lattice.edges().T
    square = np.sum((visit.weights[a] - visit.weights[b]) ** 2, axis=1)
    n = visit.lattice.size
    total: Array = np.bincount(a, square, n) + np.bincount(b, square, n).astype(float)
    return total


def density(visit: Visit, strength: float = 1.0) -> Array:
    """Gain of dense nodes: equation 7 with O the local neighbourhood, ramp of equation 8.

    rho = exp(-sum |w_bmu - w_i|^2 / its mean), g = (rho / mean rho)^(p (t/T)^4).  Dense
    attracts denser: the feedback is positive and tears the map when it is strong.
    """
    total = _local_distances(visit)
    rho = np.exp(-total / max(float(total.mean()), 1e-300))
    gain: Array = (rho / rho.mean()) ** (strength * visit.progress**4)
    return gain[visit.winners]


def lattice(visit: Visit, strength: float = 3.0) -> Array:
    """Gain of remote nodes: equation 7 summed over "each node in the lattice".

    rho = exp(-sum over all i of |w_bmu - w_i|^2 / its mean) is smallest at the border, so
    1 / rho of equation 8 favours the border, as the text says.
    """
    mean = visit.weights.mean(axis=0)
    # sum over i of |w_j - w_i|^2, up to the factor n: |w_j - mean|^2 + variance
    total = np.sum((visit.weights - mean) ** 2, axis=1)
    total = total + total.mean()
    rho = np.exp(-total / max(float(total.mean()), 1e-300))
    gain: Array = (rho.mean() / rho) ** (strength * visit.progress**4)
    return gain[visit.winners]


GAINS: dict[str, Gain | None] = {
    "som": None,
    "vdsom": border,
    "vdsom:border": border,
    "vdsom:error": error,
    "vdsom:density": density,
    "vdsom:lattice": lattice,
}


def gain_of(name: str) -> Gain | None:
    """Gain of a network by its name in ``--map``, None for the plain SOM."""
    if name not in GAINS:
        raise OptionError(f"map {name!r} is unknown, choose one of {', '.join(GAINS)}")
    return GAINS[name]
