"""Workspace: where the tip can be, and the expected error over it."""

import numpy as np

from ..common.arrays import Array, Index
from ..common.rows import finite_rows
from ..maps.map import Map
from ..model.model import Model
from .settings import SETTINGS


def extent(model: Model) -> float:
    """Longer side of the box that holds the sensory nodes [unit]."""
    return float(np.ptp(model.sensory.weights, axis=0).max())


def node_errors(model: Model) -> tuple[Array, Array]:
    """Expected error of each motor and each sensory node, (nodes,) [unit]; NaN where no row was.

    A sensory node has the mean of its motor partners' bounds, weighted by the links.
    """
    motor = np.where(model.visited, model.bounds, np.nan)
    # bounds of nodes without samples are extrapolated: they take no part
    weight = np.asarray(model.links.T @ model.visited.astype(float))
    total = np.asarray(model.links.T @ np.nan_to_num(motor))
    sensory = np.full(len(weight), np.nan)
    np.divide(total, weight, out=sensory, where=weight > 0)
    return motor, sensory


def drawn_edges(som: Map) -> Index:
    """Edges (m, 2) of a map, without those that lead once round a full turn.

    Of a lattice with three axes those of its middle sheets: all would hide each other.
    """
    gap = np.abs(np.diff(som.units[som.edges], axis=1)[:, 0])
    around = ((gap > 0.5) & som.scale.periodic).any(axis=1)
    edges = som.edges[~around]
    shape = som.lattice.shape
    if len(shape) == 3:
        places = np.indices(shape).reshape(3, -1).T
        middle = places == np.array(shape) // 2
        edges = edges[middle[edges].all(axis=1).any(axis=1)]
    return edges


def bound_field(model: Model) -> tuple[Array, Array]:
    """Positions (n, m) all over the learned range, and the bound (n,) on the true one [unit]."""
    about = model.about
    shape = SETTINGS.field, len(about.lower)
    q = np.random.default_rng(0).uniform(about.lower, about.upper, shape)
    x = model.forward(q)
    answered = finite_rows(x)
    return x[answered], model.model_error(q[answered])
