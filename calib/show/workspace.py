"""Workspace: where the tip can be, its border, and the expected error over it."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..maps.map import Map
from ..model.model import Model
from ..samples.babbling import babble
from ..samples.samples import Samples
from ..training.evaluate import simulation_of

_INSIDE = 25_000  # joint values spread over the whole range
_EDGE = 240  # joint values along each edge of the range
_CELLS = 120  # cells of the grid along the workspace's longer side
_GAP = 1.6  # cells; farther from every reached position is outside


def downwards(unit: str) -> bool:
    """Whether a unit's y points down: pixels are counted from the top of the picture."""
    return unit == "px"


def extent(model: Model) -> float:
    """Longer side of the box that holds the sensory nodes [unit]."""
    return float(np.ptp(model.sensory.weights, axis=0).max())


def sensory_errors(model: Model) -> Array:
    """Expected error of each sensory node, (nodes,) [unit].

    The mean of its motor partners' bounds, weighted by the links; NaN for nodes without
    partners that samples have visited.
    """
    # bounds of nodes without samples are extrapolated: they take no part
    known = np.where(model.visited, model.bounds, 0.0)
    total = np.asarray(model.links.T @ model.visited.astype(float))
    weighted = np.asarray(model.links.T @ known)
    return np.where(total > 0, weighted / np.where(total > 0, total, 1.0), np.nan)


def motor_errors(model: Model) -> Array:
    """Expected error of each motor node, (nodes,) [unit]; NaN where no sample was."""
    return np.where(model.visited, model.bounds, np.nan)


def drawn_edges(part: Map) -> NDArray[np.intp]:
    """Edges (m, 2) of a map, without those that lead once round a full turn."""
    edges = part.edges
    if not part.scale.periodic.any():
        return edges
    gap = np.abs(part.units[edges[:, 0]] - part.units[edges[:, 1]])
    return np.asarray(edges[~((gap > 0.5) & part.scale.periodic).any(axis=1)])


def _reached_positions(model: Model) -> Array:
    """Positions (n, 2) [unit] that cover what the arm reaches, the ends of its range too."""
    dof = len(model.about.joint_names)
    side = max(2, round(_INSIDE ** (1 / dof)))
    axis = np.linspace(0.0, 1.0, side)
    parts = [np.stack([a.ravel() for a in np.meshgrid(*[axis] * dof)], axis=1)]
    along = np.linspace(0.0, 1.0, _EDGE)
    corners = np.array(list(product([0.0, 1.0], repeat=min(dof - 1, 6))))
    # the border is reached where all joints but one are at an end of their range
    for k in range(min(dof, 7)):
        for corner in corners:
            edge = np.zeros((_EDGE, dof))
            others = [i for i in range(dof) if i != k][: corner.size]
            edge[:, others] = corner
            edge[:, k] = along
            parts.append(edge)
    x = model.forward(model.motor.scale.from_unit(np.concatenate(parts)))
    return x[np.isfinite(x).all(axis=1)]


def outline(model: Model) -> Array:
    """Border of the workspace as short pieces of line, (m, 2, 2) [unit].

    The line at a small distance from all that the arm reaches, moved onto the nearest reached
    position.
    """
    from scipy.spatial import cKDTree

    reached = _reached_positions(model)
    if len(reached) < 3:
        return np.empty((0, 2, 2))
    step = np.ptp(reached, axis=0).max() / _CELLS
    low = reached.min(axis=0) - 3 * step
    count = np.ceil((reached.max(axis=0) + 3 * step - low) / step).astype(int) + 1
    x, y = (low[k] + step * np.arange(count[k]) for k in range(2))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    tree = cKDTree(reached)
    away = np.asarray(tree.query(grid.reshape(-1, 2))[0]).reshape(count) / step
    # a level of the distance closes gaps between samples that cells would leave open
    lines = level_lines(x, y, away, _GAP)
    if not len(lines):
        return lines
    nearest = np.asarray(tree.query(lines.reshape(-1, 2))[1])
    return reached[nearest].reshape(-1, 2, 2)


def level_lines(x: Array, y: Array, values: Array, level: float) -> Array:
    """Pieces (m, 2, 2) of the line where `values` (len(x), len(y)) cross a level."""
    from contourpy import contour_generator

    # contourpy has x along the columns
    lines: Any = contour_generator(x, y, values.T).lines(level)
    pieces = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
    return np.concatenate([np.empty((0, 2, 2)), *pieces])


def training_rows(model: Model, samples: Samples | None) -> tuple[Array, Array, str]:
    """Joints (n, dof) and positions (n, m) that a model learned from, and what they are.

    Those of a simulation are babbled again; of a log they are those given, else those kept.
    """
    about, simulation = model.about, simulation_of(model)
    if samples is not None:
        return np.asarray(samples.q), np.asarray(samples.x), "rows of the log"
    if simulation is not None:
        noise, changes = simulation.noise, simulation.changes
        arm, n = simulation.arm, about.samples
        drawn = babble(arm, n, seed=about.seed, noise=noise, changes=changes)
        return np.asarray(drawn.q), np.asarray(drawn.x), "babbled positions"
    if model.rows is not None:
        return model.rows.q, model.rows.x, "rows kept of the log"
    return np.empty((0, len(about.joint_names))), np.empty((0, len(model.axes))), ""
