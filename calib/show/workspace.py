"""Workspace: where the tip can be, its border, and the expected error over it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..maps.map import Map
from ..model.model import Model
from .settings import AMOUNTS

_OVER = 0.2  # of the range: joint values are drawn beyond both of its ends too
_CELLS = 120  # cells of the grid along the workspace's longer side
_GAP = 1.6  # cells; farther from every reached position is outside


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
    return motor, np.where(
        weight > 0, total / np.where(weight > 0, weight, 1.0), np.nan
    )


def drawn_edges(part: Map) -> NDArray[np.intp]:
    """Edges (m, 2) of a map, without those that lead once round a full turn."""
    gap = np.abs(np.diff(part.units[part.edges], axis=1)[:, 0])
    return np.asarray(part.edges[~((gap > 0.5) & part.scale.periodic).any(axis=1)])


def outline(model: Model) -> Array:
    """Border of the workspace in a plane as short pieces of line, (m, 2, 2) [unit]."""
    from contourpy import contour_generator
    from scipy.spatial import cKDTree

    drawn = np.random.default_rng(0).uniform(
        -_OVER, 1 + _OVER, (AMOUNTS.inside, len(model.about.lower))
    )
    # clipped ones lie on faces, edges and corners of the range, which reach the border
    reached = model.forward(model.motor.scale.from_unit(drawn.clip(0.0, 1.0)))
    reached = reached[np.isfinite(reached).all(axis=1)]
    if len(reached) < 3:
        return np.empty((0, 2, 2))
    step = np.ptp(reached, axis=0).max() / _CELLS
    low = reached.min(axis=0) - 3 * step
    high = reached.max(axis=0) + 4 * step
    x, y = (np.arange(a, b, step) for a, b in zip(low, high, strict=True))
    tree = cKDTree(reached)
    away = np.asarray(tree.query(np.stack(np.meshgrid(x, y), axis=-1))[0]) / step
    # a level of the distance closes gaps between samples that cells would leave open
    lines: Any = contour_generator(x, y, away).lines(_GAP)
    pieces = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
    return reached[tree.query(np.concatenate([np.empty((0, 2, 2)), *pieces]))[1]]


def bound_field(model: Model) -> tuple[Array, Array]:
    """Positions (n, m) all over the learned range, and the bound (n,) on the true one [unit]."""
    about = model.about
    shape = AMOUNTS.field, len(about.lower)
    q = np.random.default_rng(0).uniform(about.lower, about.upper, shape)
    x = model.forward(q)
    answered = np.isfinite(x).all(axis=1)
    return x[answered], model.model_error(q[answered])
